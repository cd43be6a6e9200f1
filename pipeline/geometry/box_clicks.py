"""Clicked corners and edges of one box as arrays, and their distances from a box in the photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.axis_box import faces_named, turn_about_y, turn_slope
from pipeline.geometry.camera import Camera


@dataclass(frozen=True)
class FaceModel:
    """Face coordinates (6,) as a linear function of the unknowns: matrix @ unknowns + offset."""

    matrix: np.ndarray  # (6, n)
    offset: np.ndarray  # (6,)

    @classmethod
    def with_fixed(cls, fixed: dict[int, float], sizes: dict[int, float]) -> "FaceModel":
        rows, offset = np.eye(6), np.zeros(6)
        for face, value in fixed.items():
            rows[face], offset[face] = 0, value
        for axis, size in sizes.items():
            upper_from_lower = axis + 3 not in fixed
            source, target = (axis, axis + 3) if upper_from_lower else (axis + 3, axis)
            rows[target], offset[target] = rows[source], offset[source] + (
                size if upper_from_lower else -size
            )
        used = [i for i in range(6) if rows[:, i].any()]
        return cls(rows[:, used], offset)

    def values(self, unknowns: np.ndarray) -> np.ndarray:
        return self.matrix @ unknowns + self.offset


@dataclass(frozen=True)
class Clicks:
    """Annotations of one box, as arrays."""

    camera: Camera
    corner_labels: list[str]
    corner_faces: np.ndarray  # (C, 3)
    corner_pixels: np.ndarray  # (C, 2)
    edge_labels: list[str]
    edge_faces: np.ndarray  # (E, 2)
    edge_pixels: np.ndarray  # (E, 2, 2)

    @classmethod
    def of(cls, camera: Camera, corners: dict, edges: dict, room: bool) -> "Clicks":
        for label, pixels, shape in [(k, p, (2,)) for k, p in corners.items()] + [
            (k, p, (2, 2)) for k, p in edges.items()
        ]:
            if np.shape(pixels) != shape or not np.isfinite(np.asarray(pixels, float)).all():
                what = "one pixel [u, v]" if shape == (2,) else "two pixels [[u, v], [u, v]]"
                raise InputError(f"'{label}' is {np.asarray(pixels).tolist()}", remedy=f"give {what}")
        clicks = cls(
            camera,
            list(corners),
            np.array([faces_named(k, 3, room) for k in corners], int).reshape(-1, 3),
            np.array(list(corners.values()), float).reshape(-1, 2),
            list(edges),
            np.array([faces_named(k, 2, room) for k in edges], int).reshape(-1, 2),
            np.array(list(edges.values()), float).reshape(-1, 2, 2),
        )
        for label, faces in zip(clicks.corner_labels, clicks.corner_faces):
            if sum((faces == other).all() for other in clicks.corner_faces) > 1:
                raise InputError(
                    f"corner '{label}' is given twice under different names", remedy="remove one"
                )
        for label, (a, b) in zip(clicks.edge_labels, clicks.edge_pixels):
            if np.hypot(*(b - a)) < 1:
                raise InputError(
                    f"edge '{label}' has both points at ({a[0]:g}, {a[1]:g})",
                    remedy="click two points well apart along that edge",
                )
        if room:
            clicks._check_horizon()
        return clicks

    def touched(self) -> set[int]:
        """Faces that some annotation names."""
        return set(self.corner_faces.ravel()) | set(self.edge_faces.ravel())

    def _check_horizon(self) -> None:
        """No point of the floor is seen above the horizon, none of the ceiling below."""
        listed = [
            (k, f, p[None]) for k, f, p in zip(self.corner_labels, self.corner_faces, self.corner_pixels)
        ]
        listed += list(zip(self.edge_labels, self.edge_faces, self.edge_pixels))
        for label, faces, pixels in listed:
            for level, sign, side, other in ((1, 1, "above", "below"), (4, -1, "below", "above")):
                rise = self.camera.directions(pixels)[:, 1] * sign
                if level in faces and (rise >= 0).any():
                    u, v = pixels[np.argmax(rise)]
                    surface = "floor" if level == 1 else "ceiling"
                    raise InputError(
                        f"'{label}' at ({u:g}, {v:g}) lies {side} the camera's horizon, where there is"
                        f" no {surface}",
                        remedy=f"move it {other} the horizon, or check the camera" "'s pitch and roll",
                    )

    def edge_axes(self) -> np.ndarray:
        """(E,) axis along which each edge runs."""
        return 3 - (self.edge_faces % 3).sum(1)

    def residuals(self, faces: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (R,) [pixel] and their slopes by faces, (R, 6) [pixel/m], and yaw, (R,) [pixel/degree].

        Two per corner (u, v), then two per edge (signed distance of each point from the edge's line).
        """
        camera, turn, slope = self.camera, turn_about_y(yaw), turn_slope(yaw)
        to_camera = np.asarray(camera.world_from_camera).T
        count = len(self.corner_labels)

        local = faces[self.corner_faces]  # (C, 3)
        seen = (local @ turn.T - camera.position) @ to_camera.T
        # a step of the solver may put a corner behind the camera; a small depth keeps it finite and costly
        depth = np.maximum(seen[:, 2], 1e-3 * np.linalg.norm(seen, axis=1) + 1e-12)
        pixels = camera.focal_length * seen[:, :2] / depth[:, None] + camera.principal_point
        by_seen = np.zeros((count, 2, 3))
        by_seen[:, 0, 0] = by_seen[:, 1, 1] = camera.focal_length / depth
        by_seen[:, :, 2] = -camera.focal_length * seen[:, :2] / depth[:, None] ** 2
        by_local = by_seen @ (to_camera @ turn)
        by_face = np.zeros((count, 2, 6))
        np.put_along_axis(by_face, np.repeat(self.corner_faces[:, None], 2, 1), by_local, 2)
        by_yaw = np.einsum("cij,cj->ci", by_seen, local @ (to_camera @ slope).T)

        line_residual, line_by_face, line_by_yaw = self._edge_residuals(faces, turn, slope)
        return (
            np.concatenate([(pixels - self.corner_pixels).ravel(), line_residual]),
            np.concatenate([by_face.reshape(-1, 6), line_by_face]),
            np.concatenate([by_yaw.ravel(), line_by_yaw]),
        )

    def _edge_residuals(self, faces, turn, slope):
        """As `residuals`, of the edges alone.

        The image of an edge is the line where the plane through the camera and the edge, of normal
        (point on edge - camera) x edge direction, cuts the photograph.
        """
        camera, to_camera = self.camera, np.asarray(self.camera.world_from_camera).T
        inverse = np.linalg.inv(camera.intrinsic_matrix)
        rows, by_face, by_yaw = [], [], []
        for pair, axis, clicked in zip(self.edge_faces, self.edge_axes(), self.edge_pixels):
            local = np.zeros(3)
            local[pair % 3] = faces[pair]
            homogeneous = np.c_[clicked, np.ones(2)] @ inverse.T  # rays in the camera frame
            along = to_camera @ turn[:, axis]
            normal = np.cross(to_camera @ (turn @ local - camera.position), along)
            d_normal = {face: np.cross(to_camera @ turn[:, face % 3], along) for face in pair}
            d_normal["yaw"] = np.cross(to_camera @ slope @ local, along) + np.cross(
                to_camera @ (turn @ local - camera.position), to_camera @ slope[:, axis]
            )
            # in the image plane at distance 1 the line's direction across is normal[:2]; f makes it pixels
            steep = np.hypot(*normal[:2]) + 1e-300
            value = camera.focal_length * (homogeneous @ normal) / steep
            gradient = {
                k: camera.focal_length * (homogeneous @ d) / steep - value * (normal[:2] @ d[:2]) / steep**2
                for k, d in d_normal.items()
            }
            block = np.zeros((2, 6))
            for face in pair:
                block[:, face] = gradient[face]
            rows.append(value)
            by_face.append(block)
            by_yaw.append(gradient["yaw"])
        if not rows:
            return np.zeros(0), np.zeros((0, 6)), np.zeros(0)
        return np.concatenate(rows), np.concatenate(by_face), np.concatenate(by_yaw)

    def back_projected(self, model: FaceModel, yaw: float) -> np.ndarray:
        """Unknowns that bring the box nearest to the clicked rays [m]: linear, so no start is needed.

        A corner should lie on its ray: two perpendicular distances vanish. An edge should lie in the
        plane of its direction and the ray of each of its points: one distance vanishes per point.
        """
        turn = turn_about_y(yaw)
        normals, chosen = [], []
        for ray, faces in zip(self.camera.directions(self.corner_pixels), self.corner_faces):
            for across in np.linalg.svd(ray[None])[2][1:]:
                normals.append(across)
                chosen.append(faces)
        for pixels, faces, axis in zip(self.edge_pixels, self.edge_faces, self.edge_axes()):
            for ray in self.camera.directions(pixels):
                across = np.cross(ray, turn[:, axis])
                normals.append(across / (np.linalg.norm(across) + 1e-300))
                chosen.append(faces)
        rows = np.zeros((len(normals), 6))
        for row, normal, faces in zip(rows, normals, chosen):
            row[faces] = (normal @ turn)[faces % 3]
        target = np.array([normal @ self.camera.position for normal in normals]) - rows @ model.offset
        return np.linalg.lstsq(rows @ model.matrix, target, rcond=1e-9)[0]
