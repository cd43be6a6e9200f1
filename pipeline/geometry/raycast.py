"""First surface that each ray meets: depth and face maps of a scene of planar polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry.planes import polygon_area_vector

_BLOCK_VALUES = 4_000_000  # float64 values of scratch space at a time: 32 MB


def first_hits(
    origin: np.ndarray, directions: np.ndarray, faces: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) [m] along each ray to the first face, and that face's index (H, W) int32.

    origin: (3,) world [m]. directions: (H, W, 3) unit vectors. faces: planar simple polygons, (n, 3),
    convex or not, both sides of which count. Where nothing is hit: depth inf, index -1.

    Whether a ray passes inside a face is decided by the parity of crossed edges, as for a point in a
    polygon. The two signs that enter belong to the ray and a vertex (which side of a plane through
    the ray it lies on) and to the ray and an edge (which side of the edge's plane through the origin
    the ray lies on); faces that share a vertex or an edge share the computed number, so that between
    neighbours no ray is lost and none counts twice (within rounding of a corner it may meet all the
    faces there, at the same depth). Neighbours must share their corners (to 1e-12 of
    the scene's extent); a corner in the middle of another face's edge has no such guarantee.
    A face whose plane holds the origin is seen edge-on, and not hit.
    """
    directions = np.asarray(directions, float)
    depth = np.full(directions.shape[:2], np.inf)
    index = np.full(directions.shape[:2], -1, np.int32)
    scene = _Scene.around(np.asarray(origin, float), faces)
    rows = scene.rows_at_once(directions.shape[1])
    for top in range(0, directions.shape[0], rows):
        block = slice(top, top + rows)
        depth[block], index[block] = scene.hits(directions[block])
    return depth, index


@dataclass(frozen=True)
class _Scene:
    """Faces relative to the origin of all rays, in units of their extent."""

    corners: np.ndarray  # (V, 3), each shared corner once
    edges: np.ndarray  # (E, 2) indices into corners, each shared edge once
    face_edges: list[np.ndarray]  # per face, indices into edges
    normals: np.ndarray  # (F, 3), unit length (0 for a face that cannot be hit)
    offsets: np.ndarray  # (F,) distance of the origin from the face's plane, along the normal
    farthest: np.ndarray  # (F,) distance of the face's farthest corner
    extent: float

    @classmethod
    def around(cls, origin: np.ndarray, faces: list[np.ndarray]) -> "_Scene":
        relative = [np.asarray(face, float) - origin for face in faces]
        stacked = np.concatenate(relative) if relative else np.zeros((0, 3))
        # a power of two, so that the unit of length changes no digit
        extent = 2.0 ** np.ceil(np.log2(np.abs(stacked).max(initial=0.0) or 1.0))
        stacked = stacked / extent
        # corners that differ by rounding of whoever computed them are one corner
        _, first, which = np.unique(np.round(stacked, 12), axis=0, return_index=True, return_inverse=True)
        corners, which = stacked[first], which.reshape(-1)
        starts = np.cumsum([0] + [len(face) for face in relative])
        loops = [which[a:b] for a, b in zip(starts[:-1], starts[1:])]
        pairs = [np.sort(np.stack([loop, np.roll(loop, -1)], 1), 1) for loop in loops]
        stacked_pairs = np.concatenate(pairs) if pairs else np.zeros((0, 2), int)
        edges, which_edge = np.unique(stacked_pairs, axis=0, return_inverse=True)
        which_edge = which_edge.reshape(-1)
        normals, offsets = np.zeros((len(loops), 3)), np.zeros(len(loops))
        for k, loop in enumerate(loops):
            vector = polygon_area_vector(corners[loop])
            area = np.linalg.norm(vector)
            offset = 0.0 if area == 0 else vector @ corners[loop].mean(0) / area
            if abs(offset) > 1e-12:  # else no area, or edge-on
                normals[k], offsets[k] = vector / area, offset
        farthest = np.array([np.linalg.norm(corners[loop], axis=1).max() for loop in loops])
        return cls(
            corners,
            edges,
            [which_edge[a:b] for a, b in zip(starts[:-1], starts[1:])],
            normals,
            offsets,
            farthest,
            extent,
        )

    def rows_at_once(self, width: int) -> int:
        per_ray = len(self.corners) + len(self.edges) + len(self.normals) + 16
        return max(1, _BLOCK_VALUES // (per_ray * max(width, 1)))

    def hits(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `first_hits`, for a block of directions."""
        rays = directions.reshape(-1, 3).T
        best = np.full(rays.shape[1], np.inf)
        index = np.full(rays.shape[1], -1, np.int32)
        if not len(self.face_edges):
            return best.reshape(directions.shape[:2]), index.reshape(directions.shape[:2])
        pole = _pole(rays)
        right_of_ray = np.cross(pole, self.corners) @ rays >= 0  # (V, rays)
        start, end = self.edges.T
        side = np.cross(self.corners[start], self.corners[end]) @ rays >= 0  # (E, rays)
        # an edge counts if it crosses the plane of ray and pole, and does so on the pole's side of the ray
        crossed = (right_of_ray[start] != right_of_ray[end]) & (side == right_of_ray[start])
        approach = self.normals @ rays
        for k, edges in enumerate(self.face_edges):
            inside = np.logical_xor.reduce(crossed[edges], axis=0) & (approach[k] * self.offsets[k] > 0)
            hit = np.flatnonzero(inside)
            # along a grazing ray the quotient is uncertain, the face's reach is not
            distance = np.minimum(self.offsets[k] / approach[k, hit], self.farthest[k])
            nearer = distance < best[hit]
            best[hit[nearer]] = distance[nearer]
            index[hit[nearer]] = k
        return (best * self.extent).reshape(directions.shape[:2]), index.reshape(directions.shape[:2])


def _pole(rays: np.ndarray) -> np.ndarray:
    """A unit vector (3,) parallel to none of the rays, (3, N): with one, all signs would be 0."""
    # directions without a simple ratio, so that axis-parallel edges and rays meet no special case
    candidates = np.array([[0.8131, 0.5171, 0.2677], [-0.3373, 0.7907, 0.5109], [0.2411, -0.4591, 0.8551]])
    candidates /= np.linalg.norm(candidates, axis=1, keepdims=True)
    return candidates[np.argmin(np.abs(candidates @ rays).max(axis=1, initial=0.0))]
