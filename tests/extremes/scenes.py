"""The tiny room with one thing taken to its extreme, and its maps."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.imaging.maps import read_map, write_map
from tests.conftest import CHAIN, TinyScene

SIZE = (24, 18)
BULB = {"type": "point", "position": {"point": [1.2, 1.4, -4]}, "intensity": [0.5, 0.4, 0.3], "radius": 0.02}
ISOTROPIC = {"type": "isotropic"}


@dataclass(frozen=True)
class Maps:
    """Of one run: transmittance, in-scattering, foggy photograph (H, W, 3), depth (H, W) [m]."""

    transmittance: np.ndarray
    in_scattering: np.ndarray
    foggy: np.ndarray
    depth: np.ndarray
    scene: TinyScene


def described(lights: dict | None = None, fog: dict | None = None, **sections) -> dict:
    """The tiny scene with one bulb; `sections` replace its own."""
    return {
        "photograph": {"file": "photograph.exr"},
        "camera": {"horizontal_field_of_view": 70, "position": [0, 1.2, 0], "look_at": [0, 1.2, -5]},
        "shapes": {"room": {"type": "room", "lower": [-2, 0, -5], "upper": [2, 2.5, 1]}},
        "lights": {"bulb": BULB} if lights is None else lights,
        "illumination": {"type": "manual"},
        "fog": fog or even(0.0, 0.5),
        "render": {"samples": 8},
        **sections}


def even(absorption: float, scattering: float, phase: dict = ISOTROPIC) -> dict:
    """Homogeneous fog of these coefficients [1/m]."""
    return {"type": "homogeneous", "absorption_coefficient": [absorption] * 3,
            "scattering_coefficient": [scattering] * 3, "phase_function": phase}


def prepared(folder: Path, scene: dict, size: tuple[int, int] = SIZE) -> TinyScene:
    """Its files: `scene` as JSON, which is YAML, and a grey photograph."""
    tiny = TinyScene(folder)
    tiny.folder.mkdir(parents=True)
    write_map(tiny.folder / "photograph.exr", np.full((size[1], size[0], 3), 0.5, np.float32))
    tiny.file.write_text(json.dumps(scene))
    return tiny


def run(folder: Path, scene: dict, size: tuple[int, int] = SIZE) -> Maps:
    """All stages up to the foggy photograph; what must hold of every result is checked."""
    tiny = prepared(folder, scene, size)
    assert tiny.run(*CHAIN) == 0
    return maps(tiny)


def maps(tiny: TinyScene) -> Maps:
    """Maps of a scene that has run, after the check that they are finite and sane."""
    build = tiny.build
    found = Maps(*(read_map(path).astype(float) for path in (
        build.transmittance, build.in_scattering(), build.foggy(".exr"), build.depth)), tiny)
    assert_sane(found)
    return found


def assert_sane(found: Maps) -> None:
    """Finite, 0 <= T <= 1, V >= 0, and C between V and the clear photograph plus V."""
    t, v, c = found.transmittance, found.in_scattering, found.foggy
    assert np.isfinite(t).all() and np.isfinite(v).all() and np.isfinite(c).all()
    assert t.min() >= 0 and t.max() <= 1 and v.min() >= 0
    clear = read_map(found.scene.build.photograph).astype(float)
    # maps are float32: a rounding of each of the two terms
    slack = 4 * np.finfo(np.float32).eps * (np.abs(clear) + v)
    assert (c >= np.minimum(clear, 0) + v - slack).all() and (c <= np.maximum(clear, 0) + v + slack).all()


def refusal(folder: Path, scene: dict, capsys) -> str:
    """The one line with which the scene is refused."""
    assert prepared(folder, scene).run(*CHAIN) != 0
    said = capsys.readouterr().err
    assert "Traceback" not in said
    lines = [line for line in said.splitlines() if line.strip()]
    assert lines, "a refusal says why"
    return lines[-1]
