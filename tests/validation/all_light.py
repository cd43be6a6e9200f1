"""What the paper's experiment leaves out: light reflected again in the photograph, and light scattered again in the fog.

The photograph has all the light that surfaces reflect. Its composite, of the lamp's light alone and with `ambient`
beside it, is held against the room in fog with ever more light; direct and singly scattered light are exact, the rest
is traced. Every traced picture is two independent ones, so that their noise cancels in a mean square error.
"""

from __future__ import annotations

import csv
import shutil
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from ruamel.yaml import YAML

from pipeline.imaging.maps import write_map
from pipeline.paths import PROJECT
from tests.reference import path_tracer
from tests.validation.chain import maps, triptych
from tests.validation.chart import chart
from tests.validation.truth import ALPHAS, DELTAS, HEIGHTS, ROOM, SCALE_HEIGHT, Fog, Truth

#: Ever more light: its name, and which of the traced shares it adds to the lamp's own.
STEPS = {"lamp's own light": (), "+ reflected again": ("reflected",),
         "+ reflected and scattered once": ("reflected", "single and reflected"),
         "all orders": ("reflected", "single and reflected", "multiple")}
#: Of these the curves are drawn; the table has all.
SHOWN = [f"lamp alone, {name}" for name in STEPS] + ["with ambient, all orders"]
#: Extinction [1/m] of fogs that absorb nothing, a quarter, or half of what they take away.
EXTINCTIONS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
ALBEDOS = (1.0, 0.75, 0.5)
_ADDED = path_tracer.SHARES.index


def run(size: int, samples: int, folder: Path) -> None:
    photograph_against_all_light(size, samples, folder)
    single_scattering_by_optical_depth(size // 2, samples, folder)


def photograph_against_all_light(size: int, samples: int, folder: Path) -> None:
    truth = Truth(size)
    photographs = [truth.clear + one["+ reflected again"] for one in pair(truth, None, samples, 1)]
    scenes = {light: write_scenes(folder / "scenes" / light.replace(" ", "_"), np.mean(photographs, 0), light)
              for light in ("lamp alone", "with ambient")}
    rows = []
    for fog in dict.fromkeys([*ALPHAS, *DELTAS, *HEIGHTS]):
        own = truth.foggy(fog)
        added = pair(truth, fog, samples, 3)
        row = {"fog": fog.name}
        composites = {}
        for light, place in scenes.items():
            t, v = maps(fog, {}, folder / "all_light" / light.replace(" ", "_"), place)
            composites[light] = [one * t + v for one in photographs]
            for name in STEPS:
                start = [truth.clear] * 2 if name == "lamp's own light" else photographs
                # without noise: what two independent pairs are wrong by in common
                wrong = [np.clip(one * t + v, 0, 1) - np.clip(own + more[name], 0, 1) for one, more in zip(start, added)]
                row[f"{light}, {name}"] = max(float((wrong[0] * wrong[1]).mean()), 0.0)
        rows.append(row)
        print("  ".join(f"{key}: {value if isinstance(value, str) else f'{value:.2g}'}" for key, value in row.items()),
              flush=True)
        if fog == DELTAS[1]:
            triptych(folder / "all_light.png", own + np.mean([one["all orders"] for one in added], 0),
                     *(np.mean(one, 0) for one in composites.values()))
    write_csv(folder / "all_light.csv", rows)
    by_name = {row["fog"]: row for row in rows}
    panels = []
    for title, fogs, x in (("absorption [1/m], scattering 0.1/m", ALPHAS, [f.absorption for f in ALPHAS]),
                           ("scattering [1/m], absorption 0.05/m", DELTAS, [f.scattering for f in DELTAS]),
                           ("extinction on the floor [1/m], height fog", HEIGHTS, [f.absorption + f.scattering for f in HEIGHTS])):
        curves = {key: [by_name[f.name][key] for f in fogs] for key in SHOWN}
        panels.append(chart(f"MSE against {title}", x, curves))
    cv2.imwrite(str(folder / "all_light_mse.png"), np.concatenate(panels, axis=1))
    print(f"done: {folder}/all_light.png, all_light_mse.png, all_light.csv")


def single_scattering_by_optical_depth(size: int, samples: int, folder: Path) -> None:
    """Of what fog adds to the picture, and of the whole picture, the part that T and V of the lamp's light hold."""
    rays, rows = ROOM.rays(size, size), []
    seen = ~rays.emitter
    for albedo in ALBEDOS:
        for extinction in EXTINCTIONS:
            fog = path_tracer.Fog(extinction * (1 - albedo), extinction * albedo)
            shares = path_tracer.trace(ROOM, rays, fog, samples // 2, 5)[:, seen].mean((1, 2))
            direct, reflected, single, single_reflected, multiple = shares
            rows.append({"albedo of the fog": albedo, "extinction [1/m]": extinction,
                         "median optical depth to the surface": float(np.median(rays.depth[np.isfinite(rays.depth)])) * extinction,
                         "V of the lamp / all scattered light": single / (single + single_reflected + multiple),
                         "scattered once / all scattered light": (single + single_reflected) / (single + single_reflected + multiple),
                         "T and V of the lamp's own light / all light": (direct + single) / shares.sum(),
                         "T of all light and V of the lamp / all light": (direct + reflected + single) / shares.sum()})
            print("  ".join(f"{key}: {value:.3g}" for key, value in rows[-1].items()), flush=True)
    write_csv(folder / "shares.csv", rows)
    panels = []
    for albedo in ALBEDOS:
        chosen = [row for row in rows if row["albedo of the fog"] == albedo]
        curves = {key: [row[key] for row in chosen] for key in list(rows[0])[3:]}
        panels.append(chart(f"share of light against optical depth, fog's albedo {albedo:g}",
                            [row["median optical depth to the surface"] for row in chosen], curves, logarithmic=True))
    cv2.imwrite(str(folder / "shares.png"), np.concatenate(panels, axis=1))
    print(f"done: {folder}/shares.png, shares.csv")


def pair(truth: Truth, fog: Fog | None, samples: int, seed: int) -> list[dict[str, np.ndarray]]:
    """Two independent pictures of `picture`, side by side."""
    with ProcessPoolExecutor(2) as pool:
        return list(pool.map(picture, [truth] * 2, [fog] * 2, [samples] * 2, [seed, seed + 1]))


def picture(truth: Truth, fog: Fog | None, samples: int, seed: int) -> dict[str, np.ndarray]:
    """By step, what it adds to the lamp's own light, (size, size, 3)."""
    traced = path_tracer.trace(ROOM, truth.rays, fog and path_tracer.Fog(
        fog.absorption, fog.scattering, 0.0, SCALE_HEIGHT if fog.height else None), samples, seed)
    return {name: sum((traced[_ADDED(share)] for share in shares), np.zeros_like(traced[0])).reshape(
        truth.size, truth.size, 3) for name, shares in STEPS.items()}


def write_scenes(folder: Path, photograph: np.ndarray, light: str) -> Path:
    """The Cornell scenes with this photograph, and with ambient light if it is asked for."""
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("cornell", "cornell_height"):
        (folder / name).mkdir(parents=True)
        scene = YAML().load(PROJECT / "scenes" / name / "scene.yaml")
        scene["photograph"] = {"file": "photograph.exr"}
        if light == "with ambient":
            scene["lights"]["reflected"] = {"type": "ambient"}
        write_map(folder / name / "photograph.exr", photograph.astype(np.float32))
        YAML().dump(scene, folder / name / "scene.yaml")
    return folder


def write_csv(path: Path, rows: list[dict]) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
