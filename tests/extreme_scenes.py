"""A room of a dozen pixels for the extremes: stated as data, run through the stages of the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.cli import main
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from tests.conftest import CHAIN

WIDTH, HEIGHT = 16, 12
GREY = 0.5
#: Lights of the room by kind; each falls on what the camera sees.
LIGHTS: dict[str, dict[str, Any]] = {
    "ambient": {"type": "ambient", "radiance": [3.0, 2.0, 1.0]},
    "point": {"type": "point", "position": {"point": [-0.5, 1.7, -1.6]}, "intensity": [3.0, 2.0, 1.0]},
    "spot": {"type": "spot", "position": {"point": [-0.6, 2.2, -1.2]}, "target": {"point": [0.3, 0.0, -1.4]},
             "inner_angle": 20.0, "outer_angle": 35.0, "intensity": [3.0, 2.0, 1.0]},
    "area": {"type": "area", "radiance": [3.0, 2.0, 1.0], "sub_lights": 2, "outline": {"points": [
        [-0.25, 2.39, -1.7], [0.25, 2.39, -1.7], [0.25, 2.39, -1.3], [-0.25, 2.39, -1.3]]}},
}


def fog(extinction: float, albedo: float = 1.0, asymmetry: float | None = None) -> dict[str, Any]:
    """Even fog of these coefficients [1/m]."""
    phase = {"type": "isotropic"} if asymmetry is None else {"type": "henyey_greenstein", "asymmetry": asymmetry}
    return {"type": "homogeneous", "absorption_coefficient": [(1 - albedo) * extinction] * 3,
            "scattering_coefficient": [albedo * extinction] * 3, "phase_function": phase}


def sun(direction) -> dict[str, Any]:
    """Sun through a window in the left wall, with the patch that it throws on the floor."""
    window = np.array([[-1.5, 1, -2.4], [-1.5, 2, -2.4], [-1.5, 2, -1.5], [-1.5, 1, -1.5]])
    along = np.asarray(direction, float)
    patch = window - along * (window[:, 1:2] / along[1])
    return {"type": "sun", "direction": along.tolist(), "irradiance": [3.0, 2.0, 1.0], "openings": {
        "window": {"window": {"points": window.tolist()}, "patches": [{"points": patch.tolist()}]}}}


def room(lights: dict[str, Any], medium: dict[str, Any], scale: float = 1.0, **sections: Any) -> dict[str, Any]:
    """The scene file's data, all lengths times `scale` [1]; lights and medium are taken as they are."""
    return {
        "photograph": {"file": "photograph.exr"},
        "camera": {"position": [0.03 * scale, 1.43 * scale, 1.3 * scale],
                   "look_at": [0.02 * scale, 1.1 * scale, -2 * scale], "horizontal_field_of_view": 65},
        "shapes": {"room": {"type": "room", "lower": [-1.5 * scale, 0, -3 * scale],
                            "upper": [1.5 * scale, 2.4 * scale, 1.6 * scale]}},
        "lights": lights, "illumination": {"type": "manual"}, "fog": medium, "render": {"samples": 4}, **sections}


def written(folder: Path, scene: dict[str, Any], photograph: np.ndarray | float = GREY) -> Build:
    """The scene file and its photograph, linear (H, W, 3) or grey."""
    build = Build("extreme", None, folder / "scenes", folder / "build")
    build.source.mkdir(parents=True)
    write_map(build.source / "photograph.exr",
              np.broadcast_to(np.asarray(photograph, np.float32), (HEIGHT, WIDTH, 3)
                              if np.ndim(photograph) == 0 else np.shape(photograph)).copy())
    build.scene_file.write_text(json.dumps(scene))  # JSON is YAML
    return build


def status(build: Build, *stages: str, overrides: tuple[str, ...] = ()) -> int:
    """Exit status of the first stage that fails, or 0."""
    for stage in stages or CHAIN:
        stated = [f"--set={override}" for override in overrides] if stage == "resolve" else []
        code = main([stage, "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds),
                     *stated])
        if code:
            return code
    return 0


def fogged(build: Build, *overrides: str, rtol: float = 1e-6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """T, V and C of the whole chain, which must hold what every picture holds; rtol: of C = R T + V as they are stored."""
    assert status(build, overrides=overrides) == 0
    t, v, c = (read_map(path).astype(float)
               for path in (build.transmittance, build.in_scattering(), build.foggy(".exr")))
    sane(t, v, c, read_map(build.photograph), rtol)
    return t, v, c


def sane(t: np.ndarray, v: np.ndarray, c: np.ndarray, radiance: np.ndarray, rtol: float = 1e-6) -> None:
    """Finite, 0 <= T <= 1, V >= 0 and C = R T + V."""
    assert np.isfinite(t).all() and np.isfinite(v).all() and np.isfinite(c).all()
    assert t.min() >= 0 and t.max() <= 1 and v.min() >= 0
    # written as float32: 6e-8 of each of the three
    np.testing.assert_allclose(c, radiance * t + v, rtol=rtol, atol=1e-30)


def depth(build: Build) -> np.ndarray:
    """(H, W, 1) [m]."""
    return read_map(build.depth).astype(float)[..., None]
