"""Draws what was estimated over the photograph: camera frame, shapes, lights, windows, patches, shafts, sun.

Colours follow Zhao et al. 2013: of Fig. 6 windows red, sun patches green, a window cast along the sun purple, the
edges of the sunlight's volume blue; of Fig. 7b upright regions red, ground green, sky blue. Solid things are white
(seen from inside) or cyan, lamps orange.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.imaging.canvas import AXES, HORIZON, Canvas
from pipeline.imaging.overlay_lines import cast_window, edges_of, shaft_edges, sun_arrow
from pipeline.imaging.overlay_outdoors import OPEN_AIR_COLOURS, OpenAir, draw_open_air, draw_sunlight
from pipeline.plugins.annotations import Outline, Position
from pipeline.plugins.base import Light, Shape
from pipeline.plugins.lights.sun import Opening, Sun
from pipeline.plugins.lights.sunlight import Sunlight

COLOURS = {
    "room": (255, 255, 255), "shape": (70, 225, 235), "lamp": (255, 165, 50), "window": (255, 85, 85),
    "patch": (85, 235, 120), "cast": (205, 110, 255), "shaft": (85, 155, 255), "sun": (255, 236, 80),
    "horizon": HORIZON, **AXES, **OPEN_AIR_COLOURS}


def overlay(photograph: np.ndarray, camera: Camera, shapes: Mapping[str, Shape], lights: Mapping[str, Light],
            depth: np.ndarray, clicks: Sequence[tuple[np.ndarray, np.ndarray]] = (), air: OpenAir | None = None
            ) -> np.ndarray:
    """The annotated picture (h, w, 3) uint8, of at most 2000 pixels on its long side.

    photograph: uint8, RGB as on a screen, of any size; camera: of the true size (H, W); all is placed.
    depth: (h, w) radial [m], of any size, tells hidden edges (thin) from visible ones. clicks: pairs of pixels (2,) of the
    photograph, an annotated corner and the corner fitted to it. air: of a scene in the open air.
    """
    canvas = Canvas(photograph, camera, depth)
    if air is not None:
        draw_open_air(canvas, air)
    for name, shape in shapes.items():
        colour = COLOURS["shape" if shape.casts_shadow else "room"]
        for a, b in edges_of(shape.faces().values()):
            canvas.edge(a, b, colour)
        if shape.casts_shadow:
            canvas.label(np.concatenate(list(shape.faces().values())), name, colour)
    for name, light in lights.items():
        if isinstance(light, Sun):
            for key, opening in light.openings.items():
                _draw_opening(canvas, name, key, opening, light.direction)
        else:
            _draw_lamp(canvas, name, light)
    for clicked, fitted in clicks:
        canvas.click(clicked, fitted)
    canvas.horizon()
    canvas.axes("floor" if air is None else "ground")
    for name, light in lights.items():
        if isinstance(light, Sunlight) and light.direction is not None:
            draw_sunlight(canvas, name, np.asarray(light.direction))
    return canvas.finished()


def _draw_lamp(canvas: Canvas, name: str, light: Light) -> None:
    """Whatever places the light: outlines and positions, of lights from outside packages too."""
    placed = [value for _, value in light if isinstance(value, (Outline, Position))]
    points = [value.vector for value in placed if isinstance(value, Position) and value.point is not None]
    for a, b in zip(points, points[1:]):
        canvas.arrow(a, b, COLOURS["lamp"], 1.6)
    for value in placed:
        if isinstance(value, Outline) and value.points is not None:
            canvas.polygon(value.polygon, COLOURS["lamp"], name)
    for point in points[:1]:
        canvas.marker(point, COLOURS["lamp"], name)
    many = [position.vector for _, value in light if isinstance(value, list)
            for position in value if isinstance(position, Position) and position.point is not None]
    for point in many:
        canvas.marker(point, COLOURS["lamp"], name, 1.0 if len(many) < 10 else 0.6)


def _draw_opening(canvas: Canvas, name: str, key: str, opening: Opening, direction: Sequence[float] | None
                  ) -> None:
    window, patches = opening.window.polygon, [p.polygon for p in opening.patches]
    for corners, edges in shaft_edges(window, patches, key):
        for a, b in edges:
            canvas.line(a, b, COLOURS["shaft"], 1.6)
        canvas.label(corners, "shaft", COLOURS["shaft"])
    for patch in patches:
        canvas.polygon(patch, COLOURS["patch"], f"{name}.{key} patch", width=4.0)
    canvas.polygon(window, COLOURS["window"], f"{name}.{key}")
    if direction is None:
        return
    direction = np.asarray(direction, float)
    for cast in cast_window(window, direction, patches):
        if len(cast) >= 3:
            canvas.polygon(cast, COLOURS["cast"], "cast", fill=0.12, width=1.4)
    start, end = sun_arrow(window, patches, direction)
    canvas.arrow(start, end, COLOURS["sun"], 3.2)
    canvas.label(start + np.outer([0.45, 0.9], end - start), name, COLOURS["sun"])
