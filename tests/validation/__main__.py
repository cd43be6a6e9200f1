"""Fig. 8, 9, 10: the composite against ground truth, and where its error comes from.

    python -m tests.validation [--size 64]

writes build/validation/: fig8.png and fig9.png (truth, composite, difference times five), mse.csv and fig10.png (mean
square error of the composite against absorption and scattering, values clipped to [0, 1] as in the paper, section 6.1).
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

from pipeline.imaging.maps import read_map
from pipeline.paths import PROJECT
from tests.validation.chart import chart
from tests.validation.truth import Fog, Truth

ALPHAS = [Fog(a, 0.1) for a in (0.0, 0.05, 0.15, 0.4)]
DELTAS = [Fog(0.05, d) for d in (0.02, 0.1, 0.3)]
HEIGHTS = [Fog(0.05, 0.2, True), Fog(0.1, 0.4, True), Fog(0.4, 0.4, True)]
#: What is changed, and how: all else is at best quality, so that each approximation stands alone.
BEST = {"lights.lamp.sub_lights": "12", "render.samples": "64", "render.transmittance_step": "0.02",
        "render.in_scattering_size": "null"}
VARIANTS = {
    "best": {},
    "default": {key: None for key in BEST},
    "1 sub-light": {"lights.lamp.sub_lights": "1", "render.transmittance_step": "100"},
    "3x3 sub-lights": {"lights.lamp.sub_lights": "3", "render.transmittance_step": "100"},
    "6 samples": {"render.samples": "6"},
    "V at a quarter": {"render.in_scattering_size": "quarter"},
    "midpoint T": {"render.transmittance": "midpoint"},
}


def maps(fog: Fog, size: int, variant: str, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """T and V of the pipeline, (size, size, 3)."""
    settings = {key: value for key, value in {**BEST, **VARIANTS[variant]}.items() if value is not None}
    settings = {key: str(max(16, size // 4)) if value == "quarter" else value for key, value in settings.items()}
    build = folder / variant.replace(" ", "_")
    command = ["make", "-s", f"scene={fog.scene}", f"fog={fog.name}", f"BUILD={build}", f"photograph.size={size}",
               *(f"{key}={value}" for key, value in settings.items())]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True,
                          env={k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "FOG_"))})
    if done.returncode:
        sys.exit(f"error: {' '.join(command)}: {done.stderr.strip().splitlines()[-1]}")
    out = build / fog.scene / fog.name
    return read_map(out / "transmittance.exr").astype(float), read_map(out / "in_scattering.exr").astype(float)


def mse(one: np.ndarray, other: np.ndarray) -> float:
    return float(((np.clip(one, 0, 1) - np.clip(other, 0, 1)) ** 2).mean())


def triptych(path: Path, truth: np.ndarray, composite: np.ndarray) -> None:
    """Ground truth, composite, difference times five, as a screen shows them."""
    shown = [truth, composite, 5 * np.abs(np.clip(truth, 0, 1) - np.clip(composite, 0, 1))]
    rows = [np.clip(one, 0, 1) ** (1 / 2.2) for one in shown]
    picture = np.round(255 * np.concatenate(rows, axis=1)[..., ::-1]).astype(np.uint8)
    cv2.imwrite(str(path), cv2.resize(picture, None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST))


def run(size: int) -> None:
    folder = PROJECT / "build" / "validation"
    folder.mkdir(parents=True, exist_ok=True)
    truth, rows = Truth(size), []
    for fog in dict.fromkeys([*ALPHAS, *DELTAS, *HEIGHTS]):
        foggy, clear = truth.foggy(fog), truth.clear
        by_t, by_v = truth.by_midpoint(fog)
        row = {"fog": fog.name, "exact but midpoint T": mse(by_t, foggy), "exact but midpoint V": mse(by_v, foggy)}
        for variant in VARIANTS:
            transmittance, scattered = maps(fog, size, variant, folder)
            composite = clear * transmittance + scattered
            row[variant] = mse(composite, foggy)
            if variant == "default" and fog in (DELTAS[1], HEIGHTS[0]):
                triptych(folder / ("fig9.png" if fog.height else "fig8.png"), foggy, composite)
        rows.append(row)
        print("  ".join(f"{key} {value if isinstance(value, str) else f'{value:.2g}'}" for key, value in row.items()),
              flush=True)
    with open(folder / "mse.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    by_name = {row["fog"]: row for row in rows}
    panels = [("absorption [1/m], scattering 0.1/m", ALPHAS, "absorption"),
              ("scattering [1/m], absorption 0.05/m", DELTAS, "scattering"),
              ("extinction on the floor [1/m], height fog", HEIGHTS, "both")]
    pictures = []
    for title, fogs, axis in panels:
        x = [f.absorption if axis == "absorption" else f.scattering if axis == "scattering" else f.absorption + f.scattering
             for f in fogs]
        curves = {key: [by_name[f.name][key] for f in fogs] for key in rows[0] if key != "fog"}
        pictures.append(chart(title, x, curves))
    cv2.imwrite(str(folder / "fig10.png"), np.concatenate(pictures, axis=1))
    print(f"done: {folder}/fig8.png, fig9.png, fig10.png, mse.csv")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="tests.validation")
    parser.add_argument("--size", type=int, default=64, help="pixels a side")
    run(parser.parse_args().size)
