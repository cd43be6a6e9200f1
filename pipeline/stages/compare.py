"""The photograph in fog by us and by others -> compare/: a picture and an EXR of each, side_by_side.png, compare.csv, compare.html.

Ground truth is truth.exr beside foggy.exr, where `make truth` has put it. Nothing of it or of any scene is run here.
"""

from __future__ import annotations

import csv
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.colour import srgb_to_linear
from pipeline.imaging.display import FLOAT_KINDS, display_exposure, displayed, shrunk, write_png
from pipeline.imaging.maps import read_map, read_metadata, write_map
from pipeline.imaging.photograph import averaged
from pipeline.imaging.strip import WIDEST, strip
from pipeline.paths import Build
from pipeline.physics.comparison import measured
from pipeline.physics.visibility import visibility
from pipeline.plugins.registry import registry
from pipeline.plugins.baseline import EFFECTS, ClearView, Foggy, OtherFog, Wanted
from pipeline.reporting.compared import compared_page
from pipeline.reporting.manifest import stage_seconds
from pipeline.scene.artefacts import image_camera, read_fog, read_json, read_placed
from pipeline.scene.truths import is_of

OURS = "ours"
COLUMNS = ("method", "title", "seconds", "rmse", "rmse_clipped_all_pixels", "times_ours", *EFFECTS, "parameters", "note")


def run(build: Build) -> None:
    if read_json(build.plan)["fog_is_clear"]:
        raise InputError("the fog is clear: nothing to compare", place=str(build.scene_file), remedy="pick a denser fog")
    clear = read_map(build.photograph).astype(float)
    ours = averaged(_ours(build), clear.shape[1::-1])
    counted = ~(read_map(build.clipped, clear.shape[:2]) > 0) & (read_map(build.surfaces, clear.shape[:2])[..., 1] < 0)
    truth, note = _truth(build)
    wanted = _wanted(truth, ours, counted)
    exposure = display_exposure(clear) if read_json(build.photograph_facts)["suffix"] in FLOAT_KINDS else 1.0
    view = _view(build, clear, displayed(clear, exposure), wanted)
    folder = build.compare
    folder.mkdir(parents=True, exist_ok=True)
    pictures, rows = {OURS: ours}, [_row(OURS, "ours", _our_seconds(build), set(EFFECTS))]
    # what needs no package comes first, the most able of each
    for name, other in sorted(registry("baselines").items(),
                              key=lambda one: (one[1].package is not None, -len(one[1].effects), one[0])):
        picture, row = _by_other(other, name, view, exposure)
        rows.append(row)
        if picture is not None:
            pictures[name] = picture
    if truth is not None:
        for row in rows:
            if row["method"] in pictures:
                found = wanted.shrunk(pictures[row["method"]])
                row["rmse"], row["rmse_clipped_all_pixels"] = measured(found, truth, wanted.counted)
                row["times_ours"] = row["rmse"] / max(rows[0]["rmse"], 1e-12)
    for name, picture in pictures.items():
        write_map(folder / f"{name}.exr", picture.astype(np.float32), {"fog:content": f"foggy photograph by {name}, linear"})
        write_png(folder / f"{name}.png", displayed(picture, exposure))
    shown = {"clear": clear, **({"truth": truth} if truth is not None else {}), **pictures}
    write_png(folder / "side_by_side.png", strip([
        (shrunk(displayed(_enlarged(picture, clear.shape), exposure), WIDEST), _caption(name, rows)) for name, picture in shown.items()]))
    facts = {"note": note, "fitted_to": wanted.what, "counted_share": float(wanted.counted.mean()),
             "size_pixel": list(wanted.picture.shape[1::-1])}
    _write_csv(folder / "compare.csv", rows)
    with replacing(folder / "compare.html") as path:
        path.write_text(compared_page(f"{build.scene}, fog {build.fog or 'default'}", rows, EFFECTS, facts), encoding="utf-8")
    _say(rows, facts, folder)


def _ours(build: Build) -> np.ndarray:
    return read_map(build.foggy(".exr")).astype(float) / 2.0 ** read_json(build.input("composite"))["exposure"]


def _truth(build: Build) -> tuple[np.ndarray | None, str]:
    """The true foggy picture (h, w, 3) or None, and a line on it."""
    if any(gain != 1 for gain in read_json(build.input("gains")).values()):
        return None, "lights have gains other than 1, of which there is no ground truth"
    if build.truth.exists():
        facts = read_json(build.truth.with_suffix(".json"))
        if facts["fog"] == read_json(build.input("fog")):
            return read_map(build.truth).astype(float), facts["about"]
        return None, f"{build.truth} is of another fog: make truth makes it anew"
    carried = build.carried_truth
    if carried.exists() and is_of(carried, read_fog(build)):
        return read_map(carried).astype(float), f"ground truth that the scene carries: {read_metadata(carried)['fog:content'].rpartition('; ')[2]}"
    return None, f"no ground truth; where the project carries a model: make truth scene={build.scene}" + (
        f" fog={build.fog}" if build.fog else "")


def _wanted(truth: np.ndarray | None, ours: np.ndarray, counted: np.ndarray) -> Wanted:
    if truth is None:
        return Wanted("our result", ours, counted, lambda picture: picture)
    size = truth.shape[1::-1]
    left_out = averaged(~counted, size) > 0
    return Wanted("ground truth", truth, ~left_out, lambda picture: averaged(picture, size))


def _view(build: Build, clear: np.ndarray, encoded: np.ndarray, wanted: Wanted) -> ClearView:
    medium, camera, scene = read_fog(build), image_camera(build), read_placed(build)
    depth = read_map(build.depth, clear.shape[:2]).astype(float)
    directions = camera.directions(camera.pixel_centres())
    absorption, scattering = medium.coefficients()
    path = medium.density_path(camera.position, camera.position + directions * depth[..., None])
    extinction = absorption + scattering
    share = np.divide(scattering, extinction, out=np.zeros(3), where=extinction > 0)
    sky = depth >= 0.999 * scene.sky_depth if scene.outdoors else np.zeros(depth.shape, bool)
    (cx, cy), f = camera.principal_point, camera.focal_length
    return ClearView(clear, encoded, depth, sky, path[..., None] * extinction, share, visibility(extinction),
                     np.array([[f, 0, cx - 0.5], [0, f, cy - 0.5], [0, 0, 1.0]]), wanted)


def _by_other(other: type[OtherFog], name: str, view: ClearView, exposure: float) -> tuple[np.ndarray | None, dict[str, Any]]:
    """Its picture (H, W, 3), linear, or None where it cannot be run; and its row of the table."""
    row = _row(name, other.title, None, other.effects)
    if other.missing():
        return None, {**row, "note": "not installed: make setup-compare"}
    print(f"  {name}", file=sys.stderr, flush=True)
    try:
        plugin = other()
        made, row["seconds"] = _timed(plugin, view)
    except Exception as error:  # a stranger's package may fail in any way; name it
        return None, {**row, "note": f"fails: {type(error).__name__}: {' '.join(str(error).split())[:200]}"}
    row["parameters"] = ", ".join(f"{key}={_short(value)}" for key, value in made.parameters.items())
    picture = np.asarray(made.picture)
    return srgb_to_linear(picture / np.float64(255)) / exposure if picture.dtype == np.uint8 else picture.astype(float), row


def _timed(plugin: OtherFog, view: ClearView) -> tuple[Foggy, float]:
    """What it makes, and seconds of a second run: the first one reads its libraries."""
    plugin.foggy(view)
    start = time.monotonic()
    made = plugin.foggy(view)
    return made, time.monotonic() - start


def _row(name: str, title: str, seconds: float | None, effects) -> dict[str, Any]:
    return {**dict.fromkeys(COLUMNS), "method": name, "title": title, "seconds": seconds, "parameters": "", "note": "",
            **{effect: effect in effects for effect in EFFECTS}}


def _our_seconds(build: Build) -> float | None:
    """Of everything from the photograph to the fog, as far as it was measured."""
    return sum(stage_seconds(build).values()) or None


def _enlarged(picture: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return picture if picture.shape == shape else cv2.resize(picture, shape[1::-1], interpolation=cv2.INTER_LINEAR)


def _caption(name: str, rows: list[dict[str, Any]]) -> list[str]:
    if name in ("clear", "truth"):
        return [{"clear": "clear", "truth": "ground truth"}[name], "the photograph" if name == "clear" else "the model itself in fog"]
    row = next(one for one in rows if one["method"] == name)
    error = "" if row["rmse"] is None else f"RMSE {row['rmse']:.4f}"
    seconds = "" if row["seconds"] is None else f"{row['seconds']:.2g} s"
    return [row["title"], ", ".join(filter(None, (error, seconds))) or "no ground truth"]


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "[" + " ".join(f"{v:.4g}" for v in value) + "]" if isinstance(value, list) else str(value)


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    with replacing(path) as name, open(name, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for row in rows:
            writer.writerow({key: "" if value is None else int(value) if isinstance(value, bool) else value
                             for key, value in row.items()})


def _say(rows: list[dict[str, Any]], facts: dict[str, Any], folder: Path) -> None:
    print(facts["note"])
    for row in rows:
        error = f"RMSE {row['rmse']:.5f}, {row['times_ours']:5.2f} times ours" if row["rmse"] is not None else ""
        seconds = "" if row["seconds"] is None else f"{row['seconds']:8.2f} s"
        print(f"{row['title']:46} {seconds:>10}  {error}{row['note']}")
    print(f"done: {folder}/side_by_side.png, compare.html, compare.csv")
