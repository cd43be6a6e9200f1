"""What is drawn over a photograph of its estimated light and geometry, as points and lines in world metres."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.planes import polygon_normal
from pipeline.geometry.shaft import bounds_other_faces, shaft_hulls
from pipeline.imaging.overlay_view import clip_polygon

Segment = tuple[np.ndarray, np.ndarray]


def edges_of(faces: Iterable[np.ndarray]) -> Iterator[Segment]:
    """Each edge of faces (n, 3) that share some, once: its ends (3,) each."""
    known = set()
    for face in faces:
        for a, b in zip(face, np.roll(face, -1, 0)):
            ends = frozenset((a.tobytes(), b.tobytes()))
            if ends not in known:
                known.add(ends)
                yield a, b


def shaft_edges(window: np.ndarray, patches: Sequence[np.ndarray], name: str) -> list[tuple[np.ndarray, list[Segment]]]:
    """Corners (n, 3) and edges of each volume between a window and its sun patches; none where they span none.

    The stage that needs the volume refuses it with its reason; the rest is still worth seeing.
    """
    try:
        return [(hull.vertices, list(edges_of(hull.vertices[list(face)] for face in hull.faces)))
                for hull in shaft_hulls(window, patches, name)]
    except InputError:
        return []


def sun_arrow(window: np.ndarray, patches: Sequence[np.ndarray], direction: np.ndarray) -> np.ndarray:
    """Ends (2, 3) [m] of an arrow along the sunlight, from the window's middle as far as its patches are."""
    middle = window.mean(0)
    length = np.linalg.norm(np.mean([patch.mean(0) for patch in patches], axis=0) - middle)
    return np.stack([middle, middle + length * direction])


def cast_window(window: np.ndarray, direction: np.ndarray, patches: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Outlines (k, 3) [m], one a patch, of the window's light where it falls (Zhao et al. 2013, Fig. 6c).

    Each lies in its patch's plane and ends where the plane of another patch, such as a wall behind the
    floor, ends it; empty (0, 3) where the light does not reach that plane.
    """
    planes = [(lambda n, p: np.append(n, n @ p.mean(0)))(polygon_normal(p), p) for p in patches]
    result = []
    for i, plane in enumerate(planes):
        rate = direction @ plane[:3]
        travel = (plane[3] - window @ plane[:3]) / rate if abs(rate) > 1e-6 else np.array([-1.0])
        if travel.min() < 0:  # parallel to the plane, or it lies behind the window
            result.append(np.zeros((0, 3)))
            continue
        bounds = [_facing(other, window.mean(0)) for j, other in enumerate(planes)
                  if j != i and bounds_other_faces(other, window, patches[i])]
        result.append(clip_polygon(window + travel[:, None] * direction, np.reshape(bounds, (-1, 4))))
    return result


def _facing(plane: np.ndarray, point: np.ndarray) -> np.ndarray:
    """The half-space n . x + c >= 0 on that side of the plane n . x = offset where `point` is."""
    half_space = np.append(plane[:3], -plane[3])
    return half_space * (1.0 if half_space[:3] @ point + half_space[3] >= 0 else -1.0)


def post_in_the_sun(foot: np.ndarray, longest: float, direction: np.ndarray) -> tuple[Segment, Segment, Segment]:
    """An upright post on the ground at `foot` (3,), its shadow, and the ray past its tip that ends that: (2 x (3,)) each.

    direction (3,): in which the light travels, downwards. longest [m]: of post and shadow. Shadows in the photograph must
    run as this one does.
    """
    reach = float(np.hypot(direction[0], direction[2]) / -direction[1])
    height = 0.6 * longest / max(1.0, reach)
    tip = foot + [0, height, 0]
    end = tip - direction * (height / direction[1])
    return (foot, tip), (foot, end), (tip - 0.8 * (end - tip), end)
