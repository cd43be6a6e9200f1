"""Cuboids from clicked corners: the room, and the proxies of the furniture in it.

A cuboid proxy follows Zheng et al. 2012 as Zhao et al. 2013, section 5.1, use them: a box whose edges
follow the axes of the room (Manhattan), placed by the corners that can be seen. The clicks are fitted
by least squares of their distances in the photograph [pixel].

`axis_box` says how corners and edges are called.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.axis_box import FACE_INDEX, SIZES, AxisBox, corner_names, edge_names
from pipeline.geometry.box_clicks import Clicks, FaceModel
from pipeline.geometry.box_fit import BoxFit, fit_clicks
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import AXES

__all__ = ["AxisBox", "BoxFit", "Support", "corner_names", "edge_names", "fit_cuboid", "fit_room"]


class Support(NamedTuple):
    """The face of a box that touches something: its `side` across `axis` lies at `coordinate` [m].

    ("y", "lower", 0.0) stands on the floor, ("y", "lower", 0.75) on a table of that height,
    ("y", "upper", 2.5) hangs from a ceiling, ("x", "lower", -2.0) stands at the left wall x = -2.
    """

    axis: Literal["x", "y", "z"]
    side: Literal["lower", "upper"]
    coordinate: float


def fit_room(
    camera: Camera,
    corners: dict[str, np.ndarray] | None = None,
    edges: dict[str, np.ndarray] | None = None,
    known: dict[str, float] | None = None,
    *,
    behind: float = 1.0,
) -> BoxFit:
    """The room whose corners and edges were clicked; its floor is y = 0 and its walls face the axes.

    corners: {name: (2,) pixel}. edges: {name: (2, 2) pixels}, two points anywhere along that edge.
    known: {left | right | back | front | ceiling: coordinate [m]}; the ceiling's is the room's height.
    behind [m]: a front wall that nothing determines is put so far behind the camera.
    Raises InputError for an unknown name, a floor point above the horizon (or a ceiling point below),
    a wall that the annotations leave open, or walls in the wrong order.
    """
    known = dict(known or {})
    allowed = ("left", "right", "back", "front", "ceiling")
    for name in known:
        if name not in allowed:
            raise InputError(f"known wall '{name}' does not exist", remedy=f"use one of {', '.join(allowed)}")
    if not behind > 0:
        raise InputError(f"front wall {behind:g} m behind the camera", remedy="state a distance above 0")
    fixed = {1: 0.0} | {FACE_INDEX[name]: float(value) for name, value in known.items()}
    clicks = Clicks.of(camera, corners or {}, edges or {}, room=True)
    assumed: tuple[str, ...] = ()
    front = FACE_INDEX["front"]
    if front not in fixed and front not in clicks.touched():
        fixed[front] = float(camera.position[2]) + behind
        assumed = ("front",)
    model = FaceModel.with_fixed(fixed, {})
    fit = fit_clicks(clicks, model, yaw=0.0, fit_yaw=False, room=True)
    warnings = list(fit.warnings)
    if not fit.box.contains(camera.position):
        x, y, z = camera.position
        warnings.append(
            f"the camera at ({x:.3g}, {y:.3g}, {z:.3g}) m stands outside the room, which it then sees through"
            " a wall: check the names of the annotations, the known walls and the camera's height"
        )
    return replace(fit, assumed=assumed, warnings=warnings)


def fit_cuboid(
    camera: Camera,
    corners: dict[str, np.ndarray],
    support: Support | tuple[str, str, float],
    *,
    yaw: float | Literal["fit"] = 0.0,
    known: dict[str, float] | None = None,
    name: str = "box",
) -> BoxFit:
    """The cuboid proxy of an object, from its visible corners and the plane that it touches.

    corners: {name: (2,) pixel}. support: as `Support`. yaw [degree]: turn about y; "fit" finds it
    between -90 and 90, for a box with a horizontal support. known: {width | height | depth: size [m]}
    along the box's own x, y, z. `name` stands in messages.
    Raises InputError where the clicks leave a face open (it says which corner to add), where the box
    comes out inverted (it says which corners conflict), or for an unknown name.
    """
    support = Support(*support)
    if support.axis not in AXES or support.side not in ("lower", "upper"):
        raise InputError(
            f"{name}: support ({support.axis}, {support.side}) is unknown",
            remedy="state axis x, y or z and side lower or upper",
        )
    if yaw != 0 and support.axis != "y":
        raise InputError(
            f"{name}: a box turned by yaw {yaw} cannot stand flat against a wall",
            remedy="support it by its lower or upper y face, or leave yaw at 0",
        )
    sizes = {}
    for size, value in (known or {}).items():
        if size not in SIZES or not value > 0:
            raise InputError(
                f"{name}: known size '{size}': {value}",
                remedy="use width, height or depth with a length above 0 m",
            )
        sizes[SIZES.index(size)] = float(value)
    model = FaceModel.with_fixed({AXES[support.axis] + 3 * (support.side == "upper"): support.coordinate},
                                 sizes)
    try:
        clicks = Clicks.of(camera, corners, {}, room=False)
        return fit_clicks(clicks, model, yaw=0.0 if yaw == "fit" else float(yaw), fit_yaw=yaw == "fit",
                          room=False)
    except InputError as error:
        raise InputError(f"{name}: {error.problem}", remedy=error.remedy, place=error.place) from None
