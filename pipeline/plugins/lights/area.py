"""Area light: a one-sided Lambertian polygon."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from pipeline.geometry.planes import polygon_area, polygon_midpoint, polygon_normal
from pipeline.physics import polygon_glow
from pipeline.physics.emitters import emitted_way, polygon_cells
from pipeline.plugins.annotations import Outline, facing
from pipeline.plugins.base import Colour, Light, Reaching, Vector, parameter


#: A side; its square is what a render pays for.
MOST_SUB_LIGHTS = 32
#: A side of the grid by which T's mean over the area is taken, at least: what is near a lamp sees it from aside.
MIN_SIDE = 3
#: Its half sizes beyond which the solid angle that it fills is a disc's, within a few per cent.
FAR = 5.0


class Area(Light):
    """A lamp or a window with an area: a one-sided Lambertian polygon of uniform radiance."""

    type: Literal["area"] = "area"
    strength_name = "radiance"
    outline: Outline = parameter(description="the emitting surface")
    radiance: Colour | None = parameter(None, "photo unit",
                                        description="known radiance; estimated when left out")
    visible: bool = parameter(True, description="whether its pixels show the emitter itself")
    faces_towards: Vector | None = parameter(
        None, "m", description="a point on its lit side; the camera when left out")
    sub_lights: int = parameter(
        5, ge=1, le=MOST_SUB_LIGHTS,
        description="its square is the number of small lights that stand for the area; 8 for glow close to"
                    " it")

    def placed(self, name, world):
        outline = self.outline.placed(f"{name}.outline", world)
        towards = world.camera.position if self.faces_towards is None else np.asarray(self.faces_towards)
        polygon = facing(outline.polygon, towards)
        return self.model_copy(update={"outline": Outline(points=polygon.tolist()),
                                       "faces_towards": towards.tolist()})

    def emitting_polygon(self):
        return self.outline.polygon if self.visible else None

    @property
    def normal(self) -> np.ndarray:
        return polygon_normal(self.outline.polygon)

    def sub_light_count(self):
        return len(polygon_cells(self.outline.polygon, self.sub_lights)[0])

    def incident(self, points):
        # E = L A cos' / (pi r^2 + d^2) style on-axis law at the midpoint, bounded near the lamp.
        centre = self.outline.polygon.mean(0)
        area = polygon_area(self.outline.polygon)
        offset = np.asarray(points, float) - centre
        distance = np.linalg.norm(offset, axis=-1)
        # behind the lamp some arrives all the same, by reflection: no point may get none at all
        cosine = np.clip((offset @ self.normal) / np.maximum(distance, 1e-12), 0.02, 1)
        return area * cosine / (distance**2 + area / np.pi), distance

    def reaching(self, points):
        points = np.asarray(points, float)
        polygon, middle = self.outline.polygon, self.midpoint()
        offset = points - middle
        path = np.sqrt(np.einsum("...i,...i->...", offset, offset))
        travels = offset / np.maximum(path, 1e-12)[..., None]
        # as a disc's, which a centre's own law comes to soon
        area = polygon_area(polygon)
        irradiance = area * np.maximum(travels @ self.normal, 0) / (path**2 + area / np.pi)
        near = path < FAR * np.linalg.norm(polygon - middle, axis=1).max()
        irradiance[near] = polygon_glow.solid_angle(points[near], polygon)
        return Reaching(irradiance, travels, path)

    def midpoint(self):
        return polygon_midpoint(self.outline.polygon)

    def finer(self, step, extinction):
        across = float(np.linalg.norm(np.ptp(self.outline.polygon, axis=0)))
        count = int(np.ceil(min(extinction * across / step, MOST_SUB_LIGHTS)))
        return self if count <= self.sub_lights else self.model_copy(update={"sub_lights": count})

    def coarser(self, count):
        return self if count >= self.sub_lights else self.model_copy(update={"sub_lights": count})

    def parts(self, count):
        return *polygon_cells(self.outline.polygon, count), self.normal

    def integrates(self, medium):
        return medium.layered

    def way_transmittance(self, medium, points, normals, step):
        across = float(np.linalg.norm(np.ptp(self.outline.polygon, axis=0)))
        extinction = np.add(*medium.coefficients())
        count = int(np.clip(np.ceil(extinction.max() * across / step), MIN_SIDE, MOST_SUB_LIGHTS))
        return emitted_way(*polygon_cells(self.outline.polygon, count), self.normal, points, normals, extinction,
                           medium.density_path)

    def completes(self, medium, faces):
        # where the density stands on a grid, the way from each part of the lamp would cost too much
        return medium.layered

    def in_scattering(self, medium, eye, directions, depth):
        return self.glow(medium, eye, directions, depth, polygon_glow.TOLERANCE)

    def glow(self, medium, eye, directions, depth, tolerance):
        shape = np.shape(depth)
        absorption, scattering = medium.coefficients()
        found = polygon_glow.in_scattering(
            self.outline.polygon, self.normal, np.asarray(eye, float), np.reshape(directions, (-1, 3)), np.ravel(depth),
            medium.density, medium.density_path, medium.phase().value, absorption + scattering, scattering, tolerance)
        return found.reshape(*shape, 3)

    def statement(self) -> dict[str, Any]:
        centres, areas = polygon_cells(self.outline.polygon, self.sub_lights)
        return {"cells": [{"centre": c, "area": a} for c, a in zip(centres.tolist(), areas.tolist())],
                "normal": self.normal.tolist()}
