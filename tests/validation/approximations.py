"""Fig. 8, 9, 10: the composite of the lamp's own light against ground truth, and where its error comes from."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np

from tests.validation.chain import maps, mse, triptych
from tests.validation.chart import chart
from tests.validation.truth import ALPHAS, DELTAS, HEIGHTS, Truth

#: What is changed, and how: all else is at best quality, so that each approximation stands alone.
BEST = {"lights.lamp.sub_lights": "12", "render.samples": "64", "render.transmittance_step": "0.02",
        "render.in_scattering_size": "20000", "render.glow_tolerance": "0.005", "render.shadow_size": "256",
        "render.shadow_lights": "12", "render.transmittance": "area"}
VARIANTS = {
    "best": {},
    "default": {key: None for key in BEST},
    "1 sub-light": {"lights.lamp.sub_lights": "1", "render.transmittance_step": "100"},
    "3x3 sub-lights": {"lights.lamp.sub_lights": "3", "render.transmittance_step": "100"},
    "6 samples": {"render.samples": "6"},
    "V at a quarter": {"render.in_scattering_size": "quarter"},
    "midpoint T": {"render.transmittance": "midpoint"},
}


def settings(variant: str, size: int) -> dict[str, str]:
    chosen = {key: value for key, value in {**BEST, **VARIANTS[variant]}.items() if value is not None}
    return {"photograph.size": str(size),
            **{key: str(max(16, size // 4)) if value == "quarter" else value for key, value in chosen.items()}}


def run(size: int, folder: Path, variants: list[str] | None = None) -> None:
    """variants: of VARIANTS those that are made, in this order; all of them if left out."""
    truth, rows, variants = Truth(size), [], variants or list(VARIANTS)
    if unknown := [one for one in variants if one not in VARIANTS]:
        raise SystemExit(f"error: no variant is called '{unknown[0]}': choose {', '.join(VARIANTS)}")
    for fog in dict.fromkeys([*ALPHAS, *DELTAS, *HEIGHTS]):
        foggy, clear = truth.foggy(fog), truth.clear
        by_t, by_v = truth.by_midpoint(fog)
        row = {"fog": fog.name, "exact but midpoint T": mse(by_t, foggy), "exact but midpoint V": mse(by_v, foggy)}
        for variant in variants:
            transmittance, scattered = maps(fog, settings(variant, size), folder / variant.replace(" ", "_"))
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
        pictures.append(chart(f"MSE against {title}", x, curves))
    cv2.imwrite(str(folder / "fig10.png"), np.concatenate(pictures, axis=1))
    print(f"done: {folder}/fig8.png, fig9.png, fig10.png, mse.csv")
