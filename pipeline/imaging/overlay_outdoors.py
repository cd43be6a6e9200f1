"""Draws what was understood of the open air: regions, foot lines, patches of light, shadows, a post in the sun."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.ndimage import find_objects

from pipeline.imaging.canvas import Canvas
from pipeline.imaging.overlay_lines import post_in_the_sun

#: Regions as in Zhao et al. 2013, Fig. 7b.
OPEN_AIR_COLOURS = {
    "vertical": (255, 90, 80), "support": (90, 225, 100), "sky": (90, 150, 255), "map": (190, 190, 190),
    "foot": (255, 255, 255), "sunlit": (255, 214, 70), "shadowed": (178, 150, 255)}
#: Long side [pixel] at which outlines are followed: finer ones cannot be told apart on a screen.
OUTLINED_AT = 2000
#: So many regions are named, the largest.
MOST_NAMES = 30


@dataclass(frozen=True)
class OpenAir:
    """What an open-air photograph was said and found to show; pixels are the photograph's.

    labels: (H, W) index into regions of what is seen, -1 for none, of any size. regions: name, class and median depth
    [m], None for none seen. feet: (n, 2) each. patches: name, sunlit or shadowed, outline (n, 2). shadows: foot, tip
    and tip's shadow (2,) each.
    """

    labels: np.ndarray
    regions: Sequence[tuple[str, str, float | None]]
    feet: Sequence[np.ndarray] = ()
    patches: Sequence[tuple[str, str, np.ndarray]] = ()
    shadows: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default=())


def draw_open_air(canvas: Canvas, air: OpenAir) -> None:
    """Regions in the colours of their classes below everything else, then what a person marked."""
    palette = np.array([*(OPEN_AIR_COLOURS[kind] for _, kind, _ in air.regions), (0, 0, 0)], np.uint8)
    canvas.tint(palette[air.labels], 0.22)
    _outline_regions(canvas, air)
    for foot in air.feet:
        canvas.trace(foot, OPEN_AIR_COLOURS["foot"], 2.4)
    for name, kind, outline in air.patches:
        canvas.area(outline, OPEN_AIR_COLOURS[kind], name)
    for foot, tip, shadow in air.shadows:
        canvas.trace(np.stack([foot, tip]), OPEN_AIR_COLOURS["foot"], 2.0)
        canvas.trace(np.stack([foot, shadow]), OPEN_AIR_COLOURS["shadowed"], 3.0)
        canvas.trace(np.stack([tip, shadow]), OPEN_AIR_COLOURS["sunlit"], 1.4)


def _outline_regions(canvas: Canvas, air: OpenAir) -> None:
    height, width = air.labels.shape
    shrink = max(1.0, max(height, width) / OUTLINED_AT)
    labels = air.labels.astype(np.float32)  # OpenCV resizes no 32-bit integers
    if shrink > 1:
        size = (max(1, round(width / shrink)), max(1, round(height / shrink)))
        labels = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST)
    labels = labels.astype(np.int32)
    scale = canvas.photograph_size / labels.shape[::-1]
    named = []
    for index, contours, middle, extent, count in region_outlines(labels, len(air.regions)):
        for contour in contours:
            canvas.trace(contour * scale, OPEN_AIR_COLOURS[air.regions[index][1]], 1.5)
        named.append((count, index, middle * scale, extent * scale))
    for _, index, middle, extent in sorted(named, key=lambda entry: -entry[0])[:MOST_NAMES]:
        name, kind, depth = air.regions[index]
        far = "" if depth is None or kind == "sky" else f" {depth:.1f} m" if depth < 10 else f" {depth:.0f} m"
        canvas.name_at(middle, extent, name + far, OPEN_AIR_COLOURS[kind])


def region_outlines(labels: np.ndarray, count: int) -> Iterator[tuple[int, list[np.ndarray], np.ndarray, float, int]]:
    """Of each region that is seen in labels (H, W) int32: its index, closed outlines (n, 2), the pixel (2,) that is farthest
    from them, twice that distance, and how many pixels it has."""
    for index, box in enumerate(find_objects(labels + 1, count)):
        if box is None:
            continue
        # a border round it, so that what ends with the picture is outlined too
        mask = np.pad((labels[box] == index).astype(np.uint8), 1)
        corner = np.array([box[1].start, box[0].start]) - 1 + 0.5
        outlines = []
        for contour in cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]:
            smooth = cv2.approxPolyDP(contour, 0.8, True)[:, 0]
            outlines.append(np.concatenate([smooth, smooth[:1]]) + corner)
        inside = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
        row, column = np.unravel_index(np.argmax(inside), inside.shape)
        yield index, outlines, np.array([column, row]) + corner, 2 * float(inside.max()), int(mask.sum())


def draw_sunlight(canvas: Canvas, name: str, direction: np.ndarray) -> None:
    """An upright post where there is room on the ground, its shadow, and the ray past its tip that ends it.

    direction (3,): in which the light travels, downwards. Shadows in the photograph must run as this one does.
    """
    foot, on_ground = canvas.free_place()
    if not on_ground or direction[1] >= 0:
        return
    post, shadow, (start, end) = post_in_the_sun(foot, canvas.length_at(foot), direction)
    canvas.line(*shadow, OPEN_AIR_COLOURS["shadowed"], 4.0)
    canvas.line(*post, OPEN_AIR_COLOURS["foot"], 2.4)
    canvas.arrow(start, end, OPEN_AIR_COLOURS["sunlit"], 2.4)
    elevation = float(np.degrees(np.arcsin(-direction[1] / np.linalg.norm(direction))))
    canvas.label(np.stack([post[1], start]), f"{name} {elevation:.0f} deg high", OPEN_AIR_COLOURS["sunlit"])
