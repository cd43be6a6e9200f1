"""Models that the project carries: what is told of them to render them in fog."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pipeline.geometry.camera import Camera, from_field_of_view
from pipeline.paths import PROJECT

SCENES = PROJECT / "scenes"


@dataclass(frozen=True)
class Group:
    """Light that reaches the fog in one way.

    switches: which of the model's lights it is. clear: the photograph shows what arrives of it, and its way to surfaces and
    fog takes nothing more (sun and sky in the open air); otherwise fog dims it on all its ways, and scatters it any number of
    times. container: lower and upper corner [m] of the fog where light comes into it from outside, through windows.
    samples: points along an eye ray where its lamps light the fog. sky (3,): radiance beyond all things.
    """

    switches: dict[str, float] = field(default_factory=dict)
    clear: bool = False
    container: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    samples: int = 64
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Model:
    """A POV-Ray model that includes in_fog.inc at its end.

    metre: its units a metre. bounces: recursion limit of its radiosity. quick: switches for light on its way between
    surfaces, where lamps may be coarser. nodes: x, y, z [m] between which light in the fog is interpolated. farthest [m]:
    where eye rays that meet nothing end. photograph: of just this model and light, linear, averaged over each pixel.
    """

    file: Path
    metre: float
    camera: Camera
    bounces: int
    groups: tuple[Group, ...]
    nodes: tuple[np.ndarray, np.ndarray, np.ndarray]
    quick: dict[str, float] = field(default_factory=dict)
    farthest: float = 60.0
    photograph: Path | None = None


def _known(scene: str) -> dict:
    return json.loads((SCENES / scene / "truth.json").read_text(encoding="utf-8"))


def _street_camera(camera: dict) -> Camera:
    return from_field_of_view(*camera["size_pixel"], camera["horizontal_field_of_view_degree"],
                              camera_height=camera["height_m"], pitch=camera["pitch_degree"])


def _bathroom() -> Model:
    known = _known("bathroom")
    c, low, high = known["camera"], known["room"]["min_m"], known["room"]["max_m"]
    camera = Camera(c["width_px"], c["height_px"], c["focal_length_px"], np.array(c["principal_point_px"]),
                    np.array(c["world_from_camera"]), np.array(c["position_m"]))
    nodes = tuple(np.linspace(a + 0.04, b - 0.04, n) for a, b, n in zip(low, high, (8, 7, 10)))
    return Model(SCENES / "bathroom/model/bathroom.pov", 1, camera, 7, (
        Group({"Sun_On": 0, "Sublights": 4}, samples=40),
        Group({"Ceiling_On": 0, "Mirror_On": 0, "Sky_On": 0}, samples=160,
              container=(tuple(low), tuple(high)))), nodes, {"Sublights": 2}, photograph=SCENES / "bathroom/photograph.exr")


def _building() -> Model:
    known = _known("building")
    nodes = (np.array([-50, -14, -6.2, -4, -1.5, 1, 3, 5, 7.2, 16, 50.0]), np.array([0.15, 1.2, 3, 6, 10, 16, 28, 80]),
             -np.array([-6, 2, 6, 10, 14, 19, 25, 32, 40, 50, 63.5, 90, 150.0]))
    group = Group(clear=True, samples=400, sky=tuple(known["sky"]["radiance_photo_unit"]))
    return Model(SCENES / "building/model/building.pov", 1, _street_camera(known["camera"]), 2, (group,), nodes,
                 farthest=2000.0, photograph=SCENES / "building/photograph.exr")


def _lamps() -> Model:
    known = _known("lamps")
    nodes = (np.array([-7.8, -5, -2.5, 0, 2.5, 5, 7.8]), np.array([0.16, 1.5, 3.2, 5, 7.5, 12, 25]),
             -np.array([-8, -2, 3, 8, 13, 17.3, 22, 30, 40, 52, 64, 79.8]))
    return Model(SCENES / "lamps/model/lamps.pov", 1, _street_camera(known["camera"]), 2, (
        Group({"Sky_On": 0}, samples=256),
        Group({"Lamps_On": 0}, clear=True, samples=1, sky=tuple(known["sky_radiance_photo_unit"]))), nodes, farthest=150.0,
        photograph=SCENES / "lamps/photograph.exr")


def _cornell() -> Model:
    eye, along = np.array([0.03, 1.04, 3.9]), np.array([-0.02, -0.07, -3.9])
    view = from_field_of_view(256, 256, 37, yaw=np.degrees(np.arctan2(along[0], -along[2])),
                              pitch=np.degrees(np.arcsin(along[1] / np.linalg.norm(along))))
    camera = replace(view, position=eye)
    nodes = (np.linspace(-0.97, 0.97, 9), np.linspace(0.03, 1.97, 9), np.array([*np.linspace(-0.97, 0.97, 9), 1.4, 2, 2.8, 3.9]))
    return Model(SCENES / "cornell/model/cornell.pov", 10, camera, 3, (Group({"Lights": 6}, samples=48),), nodes,
                 {"Lights": 3})


MODELS: dict[str, Callable[[], Model]] = {"bathroom": _bathroom, "building": _building, "lamps": _lamps, "cornell": _cornell}
