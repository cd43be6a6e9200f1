"""Sunlight shafts: the convex volumes between windows and the sun patches they throw.

Zhao et al. 2013, section 5.1 and Fig. 6(d): the sun scatters only inside the volume spanned by a
window and its patch. Planes are written (nx, ny, nz, offset) with a unit normal n and n . x = offset
on the plane, which are the two arguments of POV-Ray's `plane { <n>, offset }` (its inside is
n . x < offset).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from pipeline.errors import InputError
from pipeline.geometry.planes import Plane, clean_polygon

# Two faces of one patch meet at a fold; clicks a few pixels apart leave a gap there. Parts further
# apart than this share of the window's extent are separate beams.
FOLD_GAP = 0.1
# A face that reaches into a shaft by less than this share of its extent touches it.
TOUCHING = 1e-3
# Hulls thinner than this (volume over extent cubed) are flat: 1 mm of thickness on a 3 m shaft is 1e-4.
FLAT_VOLUME = 1e-6


@dataclass(frozen=True)
class Polyhedron:
    """A closed convex polyhedron.

    vertices: (n, 3) world [m]. faces: loops of vertex indices, counter-clockwise seen from outside;
    every edge is shared by exactly two faces. planes: (m, 4), one per face, normals outward, so that
    the inside is n . x <= offset for every plane.
    """

    vertices: np.ndarray
    faces: tuple[tuple[int, ...], ...]
    planes: np.ndarray

    @property
    def triangles(self) -> np.ndarray:
        """(t, 3) vertex indices, counter-clockwise from outside; watertight (for a `mesh2`)."""
        return np.array([(f[0], f[i], f[i + 1]) for f in self.faces for i in range(1, len(f) - 1)])

    @property
    def volume(self) -> float:
        """Enclosed volume [m^3]."""
        a, b, c = np.moveaxis((self.vertices - self.vertices[0])[self.triangles], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    def contains(self, points: np.ndarray, tolerance: float = 0.0) -> np.ndarray:
        """Whether `points`, (..., 3), lie inside or within `tolerance` [m] of the surface; (...) bool."""
        points = np.asarray(points, float)
        return np.all(points @ self.planes[:, :3].T <= self.planes[:, 3] + tolerance, -1)


def reaches_into(face: np.ndarray, volume: Polyhedron) -> bool:
    """Whether part of a planar polygon, (n, 3) [m], lies inside a convex volume, by more than touching it."""
    rim, margin = np.asarray(face, float), TOUCHING * np.ptp(volume.vertices, axis=0).max()
    for plane in volume.planes:
        heights = rim @ plane[:3] - plane[3] + margin
        if not (heights < 0).any():
            return False
        rim = _cut(rim, heights)
    return True


def _cut(rim: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """What of a polygon (n, 3) lies where heights (n,) above a plane are not positive."""
    kept = []
    for point, height, following, next_height in zip(rim, heights, np.roll(rim, -1, 0), np.roll(heights, -1)):
        if height <= 0:
            kept.append(point)
        if (height < 0 < next_height) or (next_height < 0 < height):
            kept.append(point + (following - point) * (height / (height - next_height)))
    return np.array(kept)


def planar_polygon(points: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """A checked world polygon, (m, 3) [m] in the given order, and its plane, (4,); messages call it `name`.

    Raises InputError as `clean_polygon` does, and for points that are not x, y, z.
    """
    polygon = clean_polygon(points, name=name, orient=False)
    if polygon.shape[1] != 3:
        raise InputError(f"{name}: points have {polygon.shape[1]} coordinates",
                         remedy="give x, y, z in metres")
    plane = Plane.through(polygon)
    return polygon, np.append(plane.normal, plane.normal @ plane.point)


def bounds_other_faces(plane: np.ndarray, window: np.ndarray, polygon: np.ndarray) -> bool:
    """Whether sunlight falling on `polygon` stays on the window's side of `plane`.

    True for a wall that ends the floor on which the patch begins, false for the top of a box that
    stands above it. A share of the extent is left for annotation noise at the fold.
    """
    heights = polygon @ plane[:3] - plane[3]
    side = np.sign((window @ plane[:3] - plane[3]).mean())
    return bool((heights * side).min() > -FOLD_GAP * np.ptp(window, axis=0).max())


def shaft_hulls(window: np.ndarray, patches: Sequence[np.ndarray], name: str = "window") -> list[Polyhedron]:
    """Bounding volumes of the sunlight from a window, (m, 3), to its patch, polygons (k, 3) each.

    Zhao et al. 2013, Fig. 6(d). The convex hull also fills what is concave in either polygon. A patch
    folded over several faces of a convex corner (floor, then wall) makes one hull, which is then as
    tight as one hull per part. Parts that lie apart, or over a step (the rim of a bath tub and the
    floor below it), make one hull each, and these overlap near the window: take their union.
    Raises InputError for polygons that are degenerate, or that span no volume together.
    """
    window, _ = planar_polygon(window, f"the outline of {name}")
    if not len(patches):
        raise InputError(f"{name} has no sun patch", remedy="annotate the patch that its sunlight throws")
    checked = [planar_polygon(p, f"sun patch {i + 1} of {name}") for i, p in enumerate(patches)]
    parts = [polygon for polygon, _ in checked]
    if len(parts) == 1 or _is_one_beam(window, checked):
        return [convex_hull(np.concatenate([window, *parts]), f"the sunlight shaft of {name}")]
    return [convex_hull(np.concatenate([window, part]), f"the sunlight shaft of {name} to sun patch {i + 1}")
            for i, part in enumerate(parts)]


def _is_one_beam(window: np.ndarray, checked: list[tuple[np.ndarray, np.ndarray]]) -> bool:
    convex = all(bounds_other_faces(plane, window, other)
                 for i, (_, plane) in enumerate(checked) for j, (other, _) in enumerate(checked) if i != j)
    reachable, waiting = [checked[0][0]], [polygon for polygon, _ in checked[1:]]
    gap = FOLD_GAP * np.ptp(window, axis=0).max()
    while convex and waiting:
        near = [i for i, p in enumerate(waiting) if any(_outline_distance(p, q) <= gap for q in reachable)]
        if not near:
            return False
        reachable.append(waiting.pop(near[0]))
    return convex


def _outline_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Least distance [m] from a vertex of one polygon to an edge of the other."""
    def to_edges(points, ring):
        start, along = ring, np.roll(ring, -1, 0) - ring
        offset = points[:, None] - start
        share = np.clip((offset * along).sum(-1) / (along**2).sum(-1), 0, 1)
        return np.linalg.norm(offset - share[..., None] * along, axis=-1).min()
    return float(min(to_edges(a, b), to_edges(b, a)))


def convex_hull(points: np.ndarray, name: str) -> Polyhedron:
    """Convex hull of `points`, (n, 3) [m], its coplanar triangles merged into faces.

    Raises InputError, naming `name`, when the points span no volume.
    """
    centre, extent = points.mean(0), np.ptp(points, axis=0).max()
    try:
        # Qhull's tolerances assume numbers of order one.
        hull = scipy.spatial.ConvexHull((points - centre) / extent)
        flat = hull.volume < FLAT_VOLUME
    except scipy.spatial.QhullError:
        flat = True
    if flat:
        raise InputError(f"{name} has no volume: window and sun patch lie in one plane",
                         remedy="check which plane the window and its patch were put on")
    equations, a, b, c = hull.equations, *np.moveaxis(hull.points[hull.simplices], 1, 0)
    double_area = np.cross(b - a, c - a)
    flipped = np.einsum("ij,ij->i", double_area, equations[:, :3]) < 0
    triangles = np.where(flipped[:, None], hull.simplices[:, ::-1], hull.simplices)

    # The widest triangle of a face has the best determined normal and speaks for its neighbours.
    unassigned, groups = list(np.argsort(-np.linalg.norm(double_area, axis=1))), []
    while unassigned:
        alike = np.abs(equations[unassigned] - equations[unassigned[0]]).max(1) < 1e-6
        groups.append([t for t, same in zip(unassigned, alike) if same])
        unassigned = [t for t, same in zip(unassigned, alike) if not same]

    faces, normals = [], []
    for group in groups:
        loops = _boundary_loops(triangles[group])
        faces += loops
        normals += [equations[group[0], :3]] * len(loops)
    used = np.unique(np.concatenate(faces))
    vertices, normals = points[used], np.array(normals)
    faces = tuple(tuple(int(i) for i in np.searchsorted(used, face)) for face in faces)
    offsets = (vertices @ normals.T).max(0)
    return Polyhedron(vertices, faces, np.column_stack([normals, offsets]))


def _boundary_loops(triangles: np.ndarray) -> list[tuple[int, ...]]:
    """Outline of a set of coplanar, equally oriented triangles; the triangles if that is not one loop."""
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in triangles for i in range(3)}
    after = {start: end for start, end in edges if (end, start) not in edges}
    loop = [min(after)]
    while (following := after[loop[-1]]) != loop[0] and len(loop) <= len(after):
        loop.append(following)
    return [tuple(loop)] if len(loop) == len(after) else [tuple(int(i) for i in t) for t in triangles]
