"""Sunlight that enters through windows."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field
import scipy

from pipeline.geometry.planes import Plane, polygon_area, polygon_normal
from pipeline.geometry.shaft import Polyhedron, convex_hull, reaches_into, shaft_hulls
from pipeline.physics import shaft_glow
from pipeline.physics.shaft_glow import Shaft
from pipeline.plugins.annotations import Outline, facing
from pipeline.plugins.base import Colour, Direction, Light, Model, Reaching, parameter

#: Within so many metres of a shaft a point counts as in it.
BORDER = 0.01


class Opening(Model):
    """A window or open door, and the sunlit patches that it throws."""

    window: Outline = parameter(description="the opening that the sun shines through")
    patches: Annotated[list[Outline], Field(min_length=1, max_length=20)] = parameter(
        description="the sunlit patch on the floor, and its continuation on walls, one polygon a plane")


class Sun(Light):
    """The sun through windows: parallel light inside the shafts between windows and patches."""

    type: Literal["sun"] = "sun"
    strength_name = "irradiance"
    smooth: ClassVar[bool] = False
    openings: Annotated[dict[str, Opening], Field(min_length=1, max_length=50)] = parameter(
        description="windows by name")
    direction: Direction | None = parameter(
        None, "1",
        description="in which the light travels, from the sun into the room; estimated when left out")
    irradiance: Colour | None = parameter(
        None, "photo unit * sr", description="on a surface facing the sun; estimated when left out")

    def placed(self, name, world):
        openings = {}
        for key, opening in self.openings.items():
            patches = [p.placed(f"{name}.{key}.patches[{i}]", world) for i, p in enumerate(opening.patches)]
            window = opening.window.placed(f"{name}.{key}.window", world).polygon
            inside = np.mean([p.polygon.mean(0) for p in patches], axis=0)
            openings[key] = Opening(window=Outline(points=facing(window, inside).tolist()), patches=patches)
        return self.model_copy(update={"openings": openings})

    def incident(self, points):
        # Directly lit pixels never use this. Elsewhere the sun arrives by way of its patches: their
        # area, and the way window - patch - point.
        points = np.asarray(points, float)
        irradiance, weighted_path = np.zeros(points.shape[:-1]), np.zeros(points.shape[:-1])
        for opening in self.openings.values():
            entry = opening.window.polygon.mean(0)
            for patch in opening.patches:
                centre, area = patch.polygon.mean(0), polygon_area(patch.polygon)
                distance = np.linalg.norm(points - centre, axis=-1)
                share = area / (np.pi * distance**2 + area)
                irradiance += share
                weighted_path += share * (distance + np.linalg.norm(centre - entry))
        return irradiance, weighted_path / irradiance

    def reaching(self, points):
        points, travels = np.asarray(points, float), np.asarray(self.direction, float)
        lit, path = np.zeros(points.shape[:-1]), np.zeros(points.shape[:-1])
        for one in shafts(self):
            # the patches that end a shaft are its border
            inside = np.any([(points @ planes[:, :3].T <= planes[:, 3] + BORDER).all(-1)
                             for planes in map(np.asarray, one["hulls"])], axis=0)
            normal = np.asarray(one["window_normal"])
            travelled = np.maximum((points - one["window_point"]) @ normal / (travels @ normal), 0)
            lit, path = np.where(inside, 1.0, lit), np.where(inside, travelled, path)
        return Reaching(lit, np.broadcast_to(travels, points.shape), path)

    def entry_path(self, points, medium):
        # A point is lit through the window whose opening its light crosses nearest to the centre.
        points, direction = np.asarray(points, float), np.asarray(self.direction, float)
        best, path = np.full(points.shape[:-1], np.inf), np.zeros(points.shape[:-1])
        for shaft in entries(self):
            normal = np.asarray(shaft["window_normal"])
            travelled = np.maximum((points - shaft["window_point"]) @ normal / (direction @ normal), 0)
            crossing = points - travelled[..., None] * direction
            for opening in shaft["lit_openings"]:
                corners = np.asarray(opening)
                size = np.linalg.norm(corners - corners.mean(0), axis=1).max()
                off_centre = np.linalg.norm(crossing - corners.mean(0), axis=-1) / size
                behind = medium.density_path(crossing, points)
                path = np.where(off_centre < best, behind, path)
                best = np.minimum(best, off_centre)
        return path

    def integrates(self, medium):
        return True

    def way_transmittance(self, medium, points, normals, step):
        # the sun's render says nothing of its way either: see entry_path
        return np.ones((*np.shape(points)[:-1], 3))

    def completes(self, medium, faces):
        return medium.even and not self.dimmed_by(faces)

    def dimmed_by(self, faces):
        return any(reaches_into(face, beam) for beam in beams(self) for face in faces)

    def in_scattering(self, medium, eye, directions, depth):
        absorption, scattering = medium.coefficients()
        lit = [Shaft(np.asarray(planes), np.asarray(one["window_point"]), np.asarray(one["window_normal"]))
               for one in shafts(self) for planes in one["hulls"]]
        rays, travels = np.reshape(directions, (-1, 3)), np.asarray(self.direction, float)
        found = shaft_glow.in_scattering(lit, travels, np.asarray(eye, float), rays, np.ravel(depth), absorption + scattering,
                                         scattering, medium.phase().value(-(rays @ travels)))
        return found.reshape(*np.shape(depth), 3)

    def statement(self) -> dict[str, Any]:
        return {"shafts": shafts(self)}


def entries(sun: Sun) -> list[dict[str, Any]]:
    """Where the sun comes in, for each window/patch pair.

    window_point, window_normal: plane at which the sunlight enters the fog, normal into the room.
    lit_openings: the patches, pulled back along the sunlight to the window's plane: light through them
    falls exactly on the annotated patches.
    """
    result = []
    for name, opening in sun.openings.items():
        plane = _window_plane(opening)
        result.append({
            "name": name, "window_point": plane.point.tolist(), "window_normal": plane.normal.tolist(),
            "lit_openings": [_pulled_back(p.polygon, plane, sun).tolist() for p in opening.patches]})
    return result


def shafts(sun: Sun) -> list[dict[str, Any]]:
    """What the template needs of each window/patch pair (Zhao et al. 2013, Fig. 6d), beside what `entries` says.

    hulls: (m, 4) each, outward normals and offsets [m] of the bounding volume, n.x <= c inside.
    shaft_openings: each whole volume, convex, pulled back to the window's plane.
    """
    result = []
    for entry, opening in zip(entries(sun), sun.openings.values()):
        hulls = shaft_hulls(opening.window.polygon, [p.polygon for p in opening.patches], entry["name"])
        plane = _window_plane(opening)
        result.append({
            **entry, "hulls": [hull.planes.tolist() for hull in hulls],
            "shaft_openings": [_outline(_pulled_back(hull.vertices, plane, sun)).tolist() for hull in hulls]})
    return result


def beams(sun: Sun) -> list[Polyhedron]:
    """Volumes that the light in each shaft crosses from the window's plane on."""
    result = []
    for name, opening in sun.openings.items():
        plane = _window_plane(opening)
        for hull in shaft_hulls(opening.window.polygon, [p.polygon for p in opening.patches], name):
            ends = np.concatenate([hull.vertices, _pulled_back(hull.vertices, plane, sun)])
            result.append(convex_hull(ends, f"the sunlight shaft of {name}"))
    return result


def _window_plane(opening: Opening) -> Plane:
    window = opening.window.polygon
    return Plane(window.mean(0), polygon_normal(window))


def _pulled_back(points: np.ndarray, plane: Plane, sun: Sun) -> np.ndarray:
    direction = np.asarray(sun.direction, float)
    travelled = (points - plane.point) @ plane.normal / (direction @ plane.normal)
    return points - travelled[:, None] * direction


def _outline(points: np.ndarray) -> np.ndarray:
    """Convex outline (m, 3) of coplanar points, a hundredth wider, so that its rim shades nothing inside."""
    plane = Plane.through(points)
    along = np.linalg.svd(points - plane.point)[2][:2]
    hull = scipy.spatial.ConvexHull((points - plane.point) @ along.T)
    rim = points[hull.vertices]
    return rim.mean(0) + 1.01 * (rim - rim.mean(0))
