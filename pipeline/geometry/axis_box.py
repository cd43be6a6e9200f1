"""Cuboids whose edges follow the axes of the room, and the names of their corners, edges and faces.

Names, by the world's axes: left = -x, right = +x, bottom or floor = -y, top or ceiling = +y,
back = -z, front = +z (towards the viewer). A corner is called by three faces (`front_left_bottom`),
an edge by two (`back_left` is vertical, `floor_back` runs along x); the words may come in any order.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from pipeline.errors import InputError

# Faces are counted lower x, y, z, then upper x, y, z: face i lies across axis i % 3.
FACES = ("left", "bottom", "back", "right", "top", "front")
FACE_INDEX = {name: i for i, name in enumerate(FACES)} | {"floor": 1, "ceiling": 4}
ROOM_NAMES = {"bottom": "floor", "top": "ceiling"}
SIZES = ("width", "height", "depth")  # along x, y, z of the box


def corner_names(room: bool = False) -> list[str]:
    """The eight corners: front or back, left or right, bottom or top (rooms: floor or ceiling)."""
    return [
        _corner_name(x, y, z, room)
        for z, x, y in product(("front", "back"), ("left", "right"), ("bottom", "top"))
    ]


def edge_names(room: bool = False) -> list[str]:
    """The twelve edges; floor and ceiling edges begin with their height."""
    level = [ROOM_NAMES[name] if room else name for name in ("bottom", "top")]
    return [f"{y}_{side}" for y in level for side in ("left", "right", "front", "back")] + [
        f"{z}_{x}" for z in ("front", "back") for x in ("left", "right")
    ]


def faces_named(name: str, count: int, room: bool = False) -> list[int]:
    """Face indices, sorted by axis, of a corner (count = 3) or an edge (count = 2)."""
    words = name.split("_")
    faces = sorted({FACE_INDEX[word] for word in words if word in FACE_INDEX}, key=lambda i: i % 3)
    if len(words) != count or len({face % 3 for face in faces}) != count:
        kind, known = ("corner", corner_names) if count == 3 else ("edge", edge_names)
        raise InputError(f"unknown {kind} '{name}'", remedy=f"use one of {', '.join(known(room))}")
    return faces


def _corner_name(x: str, y: str, z: str, room: bool) -> str:
    return f"{z}_{x}_{ROOM_NAMES[y] if room else y}"


@dataclass(frozen=True)
class AxisBox:
    """A cuboid [m]: lower (3,) and upper (3,) corner in a frame turned by yaw [degree] about the y axis.

    The frame shares the world's origin; with yaw = 0 it is the world's. Positive yaw turns to the right
    (clockwise from above), like the camera's.
    """

    lower: np.ndarray
    upper: np.ndarray
    yaw: float = 0.0

    @property
    def world_from_box(self) -> np.ndarray:
        """(3, 3) rotation; its columns are the box's x, y and z directions in the world."""
        return turn_about_y(self.yaw)

    @property
    def size(self) -> np.ndarray:
        """(3,) [m]: width, height, depth along the box's own x, y, z."""
        return np.asarray(self.upper) - self.lower

    @property
    def centre(self) -> np.ndarray:
        """(3,) world [m]."""
        return self.world_from_box @ ((np.asarray(self.lower) + self.upper) / 2)

    def corner(self, name: str) -> np.ndarray:
        """(3,) world [m]."""
        return self.world_from_box @ np.concatenate([self.lower, self.upper])[faces_named(name, 3)]

    def corners(self, room: bool = False) -> dict[str, np.ndarray]:
        """World points (3,) [m] of the eight corners by name; `room` says floor and ceiling."""
        return {name: self.corner(name) for name in corner_names(room)}

    def faces(self, room: bool = False) -> dict[str, np.ndarray]:
        """World polygons (4, 3) [m] of the six faces by name.

        Counter-clockwise from outside (normals out of the box), for a `room` from inside.
        """
        values = np.concatenate([self.lower, self.upper])
        turn, result = self.world_from_box, {}
        for face, name in enumerate(FACES):
            axis, (i, j) = face % 3, ((face + 1) % 3, (face + 2) % 3)
            chosen = np.empty((4, 3), int)
            chosen[:, axis] = face
            chosen[:, i] = [i, i + 3, i + 3, i]
            chosen[:, j] = [j, j, j + 3, j + 3]
            outward = face >= 3  # i, j, axis are right-handed: the loop is seen so from +axis
            loop = chosen if outward != room else chosen[::-1]
            # corners one by one, as `corner` makes them: faces then share theirs to the last bit
            result[ROOM_NAMES.get(name, name) if room else name] = np.array([turn @ values[c] for c in loop])
        return result

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether world `points`, (..., 3), lie in the box or on it."""
        local = np.asarray(points, float) @ self.world_from_box
        return ((local >= self.lower) & (local <= self.upper)).all(-1)


def turn_about_y(yaw: float) -> np.ndarray:
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def turn_slope(yaw: float) -> np.ndarray:
    """Derivative of `turn_about_y` per degree."""
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    return np.radians(1.0) * np.array([[-s, 0, -c], [0, 0, 0], [c, 0, -s]])
