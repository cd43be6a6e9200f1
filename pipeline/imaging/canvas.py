"""A photograph to draw on in world coordinates: lines, fills, arrows and names, clipped in 3D by `overlay_view`."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.imaging.overlay_view import COINCIDENT, ViewLines, clip_polygon

#: Least and largest long side [pixel]: names must be legible, and a screen is not larger.
LONG_SIDE = (1200, 2000)
#: Drawn so many times finer and averaged: antialiasing of fills, lines and text alike.
SUPERSAMPLING = 2
#: Points [pixel of 16ths] for OpenCV's drawing, which takes integers.
FRACTION_BITS = 4
AXES = {"x": (255, 105, 105), "y": (120, 235, 120), "z": (120, 165, 255)}
HORIZON = (190, 190, 190)


class Canvas:
    """The photograph at drawing size, and how world points come onto it."""

    def __init__(self, photograph: np.ndarray, camera: Camera, depth: np.ndarray):
        height, width = camera.height, camera.width
        long_side = max(height, width)
        scale = float(np.clip(long_side, *LONG_SIDE)) / long_side
        self.size = (max(1, round(width * scale)), max(1, round(height * scale)))
        size = (self.size[0] * SUPERSAMPLING, self.size[1] * SUPERSAMPLING)
        enlarge = cv2.INTER_CUBIC if max(size) > max(photograph.shape) else cv2.INTER_AREA
        # darker, so that lines stand out from white walls
        self.image = (cv2.resize(photograph, size, interpolation=enlarge) * 0.72).astype(np.uint8)
        self.plain = self.image.copy()
        self.camera, self.photograph_size = camera.resized(*size), np.array([width, height])
        #: pixels of the canvas in one of the photograph, (2,)
        self._scale = np.array(size) / self.photograph_size
        self.depth = depth
        self.farthest = cv2.dilate(depth.astype(np.float32), np.ones((3, 3), np.uint8))
        self.unit = min(max(size), 2 * min(size)) / 1000
        # middle and extent [pixel] of what is named, its name and colour
        self.labels: list[tuple[np.ndarray, np.ndarray, str, tuple]] = []
        self.lines = ViewLines(self.camera, 12 * self.unit, float(depth.max()))

    def _stroke(self, pixels: np.ndarray, colour: tuple, width: float, cased: bool = True) -> None:
        """A line through `pixels` (n, 2), in `width` thousandths of the picture, dark along its sides."""
        points = [_fixed_point(pixels)]
        strokes = [((0, 0, 0), width + 1.6), (colour, width)] if cased else [(colour, width)]
        for tone, thickness in strokes:
            cv2.polylines(self.image, points, False, tone, max(1, round(thickness * self.unit)), cv2.LINE_AA,
                          FRACTION_BITS)

    def line(self, a: np.ndarray, b: np.ndarray, colour: tuple, width: float = 1.6, cased: bool = True
             ) -> np.ndarray | None:
        """A world segment; its visible ends' pixels (2, 2), or None."""
        pixels = self.lines.segment(a, b)
        if pixels is not None:
            self._stroke(pixels, colour, width, cased)
        return pixels

    def edge(self, a: np.ndarray, b: np.ndarray, colour: tuple) -> None:
        """A solid thing's edge: thick where it is seen, thin where something stands before it."""
        for shown, pixels in self.lines.edge(a, b, self.farthest):
            self._stroke(pixels, colour, 2.2 if shown else 0.8, cased=shown)

    def polygon(self, points: np.ndarray, colour: tuple, name: str = "", fill: float = 0.2, width: float = 2.2
                ) -> None:
        """A translucent outline (n, 3) [m]; `fill` is its opacity."""
        inside = self.lines.polygon(points)
        if len(inside):
            self._fill(inside, colour, fill)
        for a, b in zip(points, np.roll(points, -1, 0)):
            self.line(a, b, colour, width)
        if name:
            self.label(points, name, colour)

    def _fill(self, pixels: np.ndarray, colour: tuple, opacity: float) -> None:
        mask = np.zeros(self.image.shape[:2], np.uint8)
        cv2.fillPoly(mask, [_fixed_point(pixels)], 255, cv2.LINE_AA, FRACTION_BITS)
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        if len(rows):
            part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            share = mask[part][..., None] * np.float32(opacity / 255)
            self.image[part] = self.image[part] * (1 - share) + np.array(colour, np.float32) * share

    def tint(self, colours: np.ndarray, opacity: float) -> None:
        """Colours (h, w, 3) uint8 over the whole picture, which then counts as empty; black leaves it alone."""
        size = self.image.shape[1::-1]
        over = cv2.resize(colours, size, interpolation=cv2.INTER_NEAREST)
        mixed = cv2.addWeighted(self.image, 1 - opacity, over, opacity, 0)
        self.image = np.where(over.any(-1, keepdims=True), mixed, self.image)
        self.plain = self.image.copy()

    def trace(self, pixels: np.ndarray, colour: tuple, width: float = 1.6, cased: bool = True) -> None:
        """A line through pixels (n, 2) of the photograph."""
        self._stroke(self._on_canvas(pixels), colour, width, cased)

    def area(self, pixels: np.ndarray, colour: tuple, name: str, fill: float = 0.3) -> None:
        """A translucent outline (n, 2) of pixels of the photograph."""
        drawn = self._on_canvas(pixels)
        self._fill(drawn, colour, fill)
        self._stroke(np.concatenate([drawn, drawn[:1]]), colour, 1.6)
        self.name_at(np.mean(pixels, axis=0), np.ptp(pixels, axis=0), name, colour)

    def name_at(self, pixel: np.ndarray, extent: np.ndarray, text: str, colour: tuple) -> None:
        """Names something of an extent (2,) in the middle of which lies a pixel (2,) of the photograph."""
        self.labels.append((self._on_canvas(pixel), np.asarray(extent) * self._scale, text, colour))

    def _on_canvas(self, pixels: np.ndarray) -> np.ndarray:
        reach = 2 * max(self.image.shape)
        return np.clip(np.asarray(pixels, float) * self._scale, -reach, reach)

    def arrow(self, a: np.ndarray, b: np.ndarray, colour: tuple, width: float = 3.0) -> np.ndarray | None:
        pixels = self.line(a, b, colour, width)
        if pixels is None or np.linalg.norm(pixels[1] - pixels[0]) < 1:
            return None
        along = (pixels[1] - pixels[0]) / np.linalg.norm(pixels[1] - pixels[0])
        across = np.array([-along[1], along[0]])
        long = 5 * width * self.unit
        head = pixels[1] + long * np.array([0 * along, -along + 0.42 * across, -along - 0.42 * across])
        cv2.fillPoly(self.image, [_fixed_point(head)], colour, cv2.LINE_AA, FRACTION_BITS)
        cv2.polylines(self.image, [_fixed_point(head)], True, (0, 0, 0), max(1, round(0.6 * self.unit)),
                      cv2.LINE_AA, FRACTION_BITS)
        return pixels[1]

    def marker(self, point: np.ndarray, colour: tuple, name: str = "", size: float = 1.0) -> None:
        """A bulb: a cross with a ring."""
        if not self.lines.sees(np.asarray(point)[None]):
            return
        place = self.lines.pixels(self.lines.in_camera(point))
        self._ring(place, colour, 6 * size, 2.0 * size)
        self._cross(place, colour, 9 * size, 1.6 * size)
        self.label(np.asarray(point)[None], name, colour)

    def click(self, clicked: np.ndarray, fitted: np.ndarray) -> None:
        """A cross where a person clicked, a ring where the fit put that corner, a line between them."""
        clicked, fitted = np.asarray(clicked) * self._scale, np.asarray(fitted) * self._scale
        reach = 2 * max(self.image.shape)
        if not np.isfinite(fitted).all() or max(np.abs(clicked).max(), np.abs(fitted).max()) > reach:
            return
        self._stroke(np.stack([clicked, fitted]), (255, 60, 160), 1.0)
        self._ring(fitted, (255, 255, 255), 5, 1.2)
        self._cross(clicked, (255, 60, 160), 7, 1.2)

    def _ring(self, pixel: np.ndarray, colour: tuple, radius: float, width: float) -> None:
        turn = np.linspace(0, 2 * np.pi, 33)
        self._stroke(pixel + radius * self.unit * np.stack([np.cos(turn), np.sin(turn)], 1), colour, width)

    def _cross(self, pixel: np.ndarray, colour: tuple, reach: float, width: float) -> None:
        for arm in ([1, 1], [1, -1]):
            ends = np.outer([-1, 1], arm) * reach * self.unit / np.sqrt(2)
            self._stroke(pixel + ends, colour, width)

    def horizon(self) -> None:
        """Where level rays meet infinity; none for a camera that looks straight up or down."""
        pixels = self.lines.horizon()
        if pixels is not None:
            self._stroke(pixels, HORIZON, 1.0)
            end = pixels[np.argmax(pixels[:, 0])]
            place, extent = end - [40 * self.unit, 0], np.full(2, 2 * self.unit)
            self.labels.append((place, extent, "horizon", HORIZON))

    def free_place(self) -> tuple[np.ndarray, bool]:
        """Point (3,) [m] round which most room is left on the floor, or on whatever is seen; whether it is the floor."""
        step = max(1, round(max(self.depth.shape) / 120))
        depth = self.depth[step // 2 :: step, step // 2 :: step]
        rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
        pixels = (np.stack([columns, rows], -1) * step + step // 2 + 0.5) * self._scale
        points = self.camera.position + depth[..., None] * self.camera.directions(pixels)
        free = (self.image == self.plain).all(-1).astype(np.uint8)
        room = cv2.distanceTransform(np.pad(free, 1), cv2.DIST_L2, 3)[1:-1, 1:-1]  # the border is taken, too
        clearance = room[pixels[..., 1].astype(int), pixels[..., 0].astype(int)]
        floor = np.abs(points[..., 1]) < COINCIDENT * depth
        best = np.argmax(np.where(floor, clearance, -1) if floor.any() else clearance)
        return points.reshape(-1, 3)[best], bool(floor.any())

    def length_at(self, point: np.ndarray) -> float:
        """Length [m] that spans a fifth of the picture at a point (3,)."""
        return 0.2 * 1000 * self.unit * self.lines.in_camera(point)[2] / self.camera.focal_length

    def axes(self, floor_name: str = "floor") -> None:
        """The world's x, y and z, standing where most room is left on the floor, or on whatever is seen."""
        origin, on_floor = self.free_place()
        # a fifth of the photograph at most
        length = self.lines.axis_length(origin, self.length_at(origin))
        for name, axis in zip("xyz", np.eye(3)):
            tip = self.arrow(origin, origin + length * axis, AXES[name], 2.4)
            if tip is not None:
                start = self.lines.pixels(self.lines.in_camera(origin))
                out = (tip - start) / max(np.linalg.norm(tip - start), 1e-9)
                self.labels.append((tip + 16 * self.unit * out, np.full(2, np.inf), name, AXES[name]))
        middle = self.lines.pixels(self.lines.in_camera(origin))
        extent = np.full(2, 24 * self.unit)
        name = f"{f'{floor_name}, ' if on_floor else ''}{length:g} m"
        self.labels.append((middle, extent, name, (255, 255, 255)))

    def label(self, points: np.ndarray, text: str, colour: tuple) -> None:
        """Names the middle of what is seen of `points` (n, 3); of several of one name the first one seen."""
        if any(text == known for _, _, known, _ in self.labels):
            return
        inside = self.lines.in_camera(points)
        inside = clip_polygon(inside, self.lines.planes) if len(inside) in (3, 4) else inside[inside[:, 2] > 0]
        if not len(inside):
            return
        pixels = self.lines.pixels(inside)
        low, high = np.zeros(2), np.array([self.camera.width, self.camera.height])
        if (pixels.max(0) < low).any() or (pixels.min(0) > high).any():
            return
        pixels = np.clip(pixels, low, high)
        self.labels.append((pixels.mean(0), np.ptp(pixels, axis=0), text, colour))

    def finished(self) -> np.ndarray:
        """Writes the names, each moved until it covers no other, and averages down."""
        taken: list[tuple[float, float, float, float]] = []
        for label in self.labels:
            self._write(*label, taken)
        return cv2.resize(self.image, self.size, interpolation=cv2.INTER_AREA)

    def _write(self, anchor: np.ndarray, extent: np.ndarray, text: str, colour: tuple, taken: list) -> None:
        font, scale, thick = cv2.FONT_HERSHEY_SIMPLEX, 0.62 * self.unit, max(1, round(0.9 * self.unit))
        (width, height), below = cv2.getTextSize(text, font, scale, thick)
        pad = 3.5 * self.unit
        box = np.array([width + 2 * pad, height + below + 2 * pad])
        room = np.array([self.camera.width, self.camera.height]) - box
        if (room < 0).any():
            return  # no place for names in so narrow a picture
        if (extent < 1.6 * box).any():  # beside what is too small to be written on
            anchor = anchor + [0, (extent[1] + box[1]) / 2 + 2 * self.unit]
        steps = [(0, 0)] + [step for r in (1, 2, 3, 4) for step in ((0, r), (0, -r), (r / 2, 0), (-r / 2, 0))]
        corners = [np.clip(anchor - box / 2 + np.multiply(step, box * 1.08), 0, room) for step in steps]
        others = np.reshape(taken, (-1, 4))
        free = [c for c in corners if ((c + box <= others[:, :2]) | (c >= others[:, 2:])).any(1).all()]
        corner = free[0] if free else corners[0]
        taken.append((*corner, *(corner + box)))
        left, top = np.round(corner).astype(int)
        right, bottom = np.round(corner + box).astype(int)
        plate = self.image[top:bottom, left:right]
        plate[:] = plate * np.float32(0.3) + np.float32(12)
        origin = (int(left + pad), int(top + pad + height))
        cv2.putText(self.image, text, origin, font, scale, colour, thick, cv2.LINE_AA)


def _fixed_point(pixels: np.ndarray) -> np.ndarray:
    # OpenCV counts from the first pixel's centre, this project from its corner
    return np.round((pixels - 0.5) * 2**FRACTION_BITS).astype(np.int32)
