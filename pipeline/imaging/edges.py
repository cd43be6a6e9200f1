"""Borders between near and far regions, refined against the photograph: what is in front, and how much of it.

A pixel on a border shows two things. Of it `alpha` is the nearer one, of colour `front`, and the rest the farther
one, `behind`; fog dims each by its own depth. Drawn outlines are a few pixels off, and branches have holes.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

#: Depths whose ratio is nearer to 1 than this share a border that fog does not show.
LEAST_STEP = 1.15
#: Squared distance of front and behind, in encoded colour, at which colour and outline count alike.
TELLING = 0.01
#: Alpha nearer than this to 0 or 1 is 0 or 1.
UNSURE = 0.08
#: Holes in what is porous are looked for within so many radii of its outline.
HOLES_REACH = 8
#: Regularisation of the guided filter: the variance of noise within one surface, in encoded colour.
NOISE = 4e-4


@dataclass(frozen=True)
class EdgeLayers:
    """alpha (H, W) share of what is in front; front_depth, behind_depth (H, W) [m]; front, behind (H, W, 3)."""

    alpha: np.ndarray
    front_depth: np.ndarray
    behind_depth: np.ndarray
    front: np.ndarray
    behind: np.ndarray


def refined(photograph: np.ndarray, labels: np.ndarray, depth: np.ndarray, porous: np.ndarray, radius: int
            ) -> EdgeLayers:
    """Two layers a pixel of a linear photograph (H, W, 3) with drawn `labels` (H, W) and radial `depth` (H, W) [m].

    porous (H, W): where something farther may be seen through what was drawn (branches, lattices). radius
    [pixel]: how far outlines may be off; 0 leaves all as drawn. Alpha follows the line between the two sides'
    colours where these differ, and a guided filter of the outline (He et al. 2013) where they do not.
    The layers mix to the photograph: alpha * front + (1 - alpha) * behind, to rounding.
    """
    photograph = np.maximum(photograph, 0).astype(float)
    plain = EdgeLayers(np.ones(depth.shape), depth, depth, photograph, photograph)
    border = _borders(labels, depth)
    if radius == 0 or not border.any():
        return plain
    near, far = _least_and_greatest(depth, radius + 1)
    nearer = depth**2 <= near * far
    band = (_dilated(border, radius) & (far > LEAST_STEP * near))
    front_depth, behind_depth = np.where(nearer, depth, near), np.where(nearer, far, depth)
    inside = porous & ~band
    if inside.any():
        seen = ~porous & (depth > LEAST_STEP * np.median(depth[porous]))
        source = _nearest(seen)
        if source is None:
            inside[:] = False
        else:
            nearer = nearer | inside
            front_depth = np.where(inside, depth, front_depth)
            behind_depth = np.where(inside, depth[source], behind_depth)
            inside &= behind_depth > LEAST_STEP * front_depth
    mixed = band | inside
    guide = np.sqrt(np.clip(photograph, 0, 1)).astype(np.float32)
    certainty = np.square(0.2 + np.minimum(_distance(border), radius)).astype(np.float32)
    outside = certainty * ~nearer
    behind_guide, behind = _means((guide, photograph), outside, radius)
    telling = ((guide - behind_guide) ** 2).sum(-1)
    own = certainty * nearer * np.where(porous, telling > TELLING, True)
    front_guide, front = _means((guide, photograph), own, radius)
    axis = front_guide - behind_guide
    square = (axis**2).sum(-1)
    by_colour = np.clip(((guide - behind_guide) * axis).sum(-1) / np.maximum(square, 1e-9), 0, 1)
    by_outline = cv2.ximgproc.guidedFilter(guide, nearer.astype(np.float32), radius, NOISE)
    share = square**2 / (square**2 + TELLING**2)
    alpha = share * by_colour + (1 - share) * np.clip(by_outline, 0, 1)
    # noise and gradients of either side are no mixture
    alpha = np.clip((alpha - UNSURE) / (1 - 2 * UNSURE), 0, 1)
    # far from the outline what was drawn holds, and in a crown's middle holes grow rare
    away = _distance(border) / np.where(inside, HOLES_REACH * radius, radius)
    drawn = _smoothstep(2 * away - 1)
    alpha = np.where(mixed, alpha * (1 - drawn) + nearer * drawn, 1.0)
    front_depth = np.where(mixed, front_depth, depth)
    front, behind = _adding_up(photograph, alpha, front, behind)
    return EdgeLayers(alpha, front_depth, np.where(mixed, behind_depth, front_depth), front, behind)


def _smoothstep(x: np.ndarray) -> np.ndarray:
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def _borders(labels: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Pixels (H, W) beside a pixel of another region at a clearly different depth."""
    border = np.zeros(labels.shape, bool)
    for a, b in (((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
                 ((slice(1, None), slice(None)), (slice(None, -1), slice(None)))):
        step = (labels[a] != labels[b]) & (np.maximum(depth[a], depth[b]) > LEAST_STEP * np.minimum(depth[a], depth[b]))
        border[a] |= step
        border[b] |= step
    return border


def _least_and_greatest(depth: np.ndarray, radius: int) -> tuple[np.ndarray, np.ndarray]:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    image = depth.astype(np.float32)
    return cv2.erode(image, kernel).astype(float), cv2.dilate(image, kernel).astype(float)


def _dilated(mask: np.ndarray, radius: int) -> np.ndarray:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.astype(np.uint8), kernel) > 0


def _distance(mask: np.ndarray) -> np.ndarray:
    """Distance (H, W) [pixel] to the mask."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)


def _nearest(mask: np.ndarray):
    """Indices (rows, columns) of the nearest pixel of the mask for each pixel, None of an empty mask."""
    if not mask.any():
        return None
    label = cv2.distanceTransformWithLabels((~mask).astype(np.uint8), cv2.DIST_L2, 5,
                                            labelType=cv2.DIST_LABEL_PIXEL)[1]
    rows, columns = np.nonzero(mask)
    table = np.zeros((label.max() + 1, 2), int)
    table[label[mask]] = np.stack([rows, columns], 1)
    return table[label, 0], table[label, 1]


def _means(images, weight: np.ndarray, radius: int) -> list[np.ndarray]:
    """Weighted means (H, W, 3) of each image over wider and wider windows, until some weight lies in one."""
    total = [np.zeros(image.shape) for image in images]
    open_pixels, reach = np.ones(weight.shape, bool), 2 * radius
    for _ in range(4):
        size = (2 * reach + 1, 2 * reach + 1)
        sums = cv2.boxFilter(weight.astype(np.float64), -1, size, normalize=False)
        known = open_pixels & (sums > 1e-6)
        for image, mean in zip(images, total):
            product = cv2.boxFilter(image.astype(np.float64) * weight[..., None], -1, size, normalize=False)
            mean[known] = product[known] / sums[known][:, None]
        open_pixels &= ~known
        reach *= 4
    for image, mean in zip(images, total):
        mean[open_pixels] = image[open_pixels]
    return total


def _adding_up(photograph, alpha, front, behind) -> tuple[np.ndarray, np.ndarray]:
    """Colours moved as little as may be so that they mix to the photograph, none below 0."""
    a, b = alpha[..., None], 1 - alpha[..., None]
    missing = (photograph - a * front - b * behind) / (a**2 + b**2)
    front, behind = np.maximum(front + a * missing, 0), np.maximum(behind + b * missing, 0)
    mix = a * front + b * behind
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(mix > 0, photograph / mix, 0.0)
    return front * scale, behind * scale
