"""Borders between near and far regions, refined against the photograph: what is in front, and how much of it.

A pixel on a border shows two things. Of it `alpha` is the nearer one, of colour `front`, and the rest the farther
one, `behind`; fog dims each by its own depth. Drawn outlines are a few pixels off, and branches have holes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.geometry.regions import DEPTH_STEP, torn

#: Squared distance of front and behind, in encoded colour, at which colour and outline count alike.
TELLING = 0.01
#: Alpha nearer than this to 0 or 1 is 0 or 1.
UNSURE = 0.08
#: Holes in what is porous are looked for within so many radii of its outline.
HOLES_REACH = 8
#: From one radius off the outline to so many what was drawn takes over.
OUTLINE_REACH = 1.5
#: Regularisation of the guided filter: the variance of noise within one surface, in encoded colour.
NOISE = 4e-4
#: Weight of a pixel that only its colour, and not the outline, counts to what is in front.
BY_COLOUR = 0.01
#: Pixels a side that are refined at once.
TILE = 512
_BLOCK = 1_000_000


@dataclass(frozen=True)
class EdgeLayers:
    """alpha (H, W) share of what is in front; front_depth, behind_depth (H, W) [m]; front, behind (H, W, 3)."""

    alpha: np.ndarray
    front_depth: np.ndarray
    behind_depth: np.ndarray
    front: np.ndarray
    behind: np.ndarray


def refined(photograph: np.ndarray, labels: np.ndarray, depth: np.ndarray, porous: np.ndarray, radius: int,
            mixed_only: bool = False) -> EdgeLayers:
    """Two layers a pixel of a linear photograph (H, W, 3) with drawn `labels` (H, W) and radial `depth` (H, W) [m].

    porous (H, W): where something farther may be seen through what was drawn (branches, lattices). radius
    [pixel]: how far outlines may be off; 0 leaves all as drawn. Alpha follows the line between the two sides'
    colours where these differ, and a guided filter of the outline (He et al. 2013) where they do not.
    The layers mix to the photograph: alpha * front + (1 - alpha) * behind, to rounding. mixed_only: depths and colours
    are 0 far from borders, which takes no memory of large photographs, and all are float32.
    """
    border, within_one = _borders(labels, depth)
    if within_one.any():  # a depth map: things as far as one another go by one label
        split = np.isin(labels, np.unique(labels[within_one]))
        shell = 1 + labels.max() + np.floor(np.log(np.maximum(depth, 1e-6) / 1e-6) / np.log(DEPTH_STEP)).astype(int)
        labels = np.where(split, shell, labels)
    if mixed_only:
        nothing = (np.zeros(shape, np.float32) for shape in (depth.shape, depth.shape, (*depth.shape, 3), (*depth.shape, 3)))
        found = EdgeLayers(np.ones(depth.shape, np.float32), *nothing)
    else:
        photograph = np.maximum(photograph, 0)
        found = EdgeLayers(np.ones(depth.shape), np.array(depth, float), np.array(depth, float), photograph.copy(),
                           photograph.copy())
    if radius == 0 or not border.any():
        return found
    white = max(float(np.percentile(np.maximum(photograph[::4, ::4], 0).max(-1), 99.5)), 1e-30)
    reach = int(np.ceil(radius * (HOLES_REACH if porous.any() else OUTLINE_REACH)))
    for core, wide, within in _tiles(border, reach, reach + 4 * radius):
        tile = _Tile(np.maximum(photograph[wide], 0).astype(float), labels[wide], np.asarray(depth[wide], float), porous[wide],
                     border[wide], radius, white)
        layers = tile.layers()
        if mixed_only and not tile.mixed[within].any():
            continue
        for name, values in vars(layers).items():
            if mixed_only and name != "alpha":
                values = np.where(tile.mixed[..., None] if values.ndim == 3 else tile.mixed, values, 0)
            getattr(found, name)[core] = values[within]
    return found


def _tiles(border: np.ndarray, reach: int, margin: int) -> Iterator[tuple]:
    """Tiles with a border within reach: themselves, with a margin round them, and themselves within that."""
    height, width = border.shape
    for top in range(0, height, TILE):
        for left in range(0, width, TILE):
            bottom, right = min(top + TILE, height), min(left + TILE, width)
            if border[max(top - reach, 0):bottom + reach, max(left - reach, 0):right + reach].any():
                y, x = max(top - margin, 0), max(left - margin, 0)
                yield (np.s_[top:bottom, left:right], np.s_[y:bottom + margin, x:right + margin],
                       np.s_[top - y:bottom - y, left - x:right - x])


class _Tile:
    """A part of the photograph; names as in `refined`. white: radiance that a guide of 1 stands for."""

    def __init__(self, photograph, labels, depth, porous, border, radius, white):
        self.photograph, self.labels, self.depth, self.porous = photograph, labels, depth, porous
        self.border, self.radius = border, radius
        self.guide = np.sqrt(np.clip(photograph / white, 0, 1)).astype(np.float32)
        self.distance = _distance(border)
        self._across()

    def _across(self) -> None:
        """What lies on the other side of each pixel's nearest border, and which of the two is in front."""
        shape, flat = self.labels.shape, self.depth.ravel()
        other, self.away = np.zeros(shape, int), np.full(shape, np.inf, np.float32)
        for label in np.unique(self.labels[self.border]):
            away, index = _nearest(self.border & (self.labels == label))
            beyond = flat[index]
            stepped = np.maximum(beyond, self.depth) > DEPTH_STEP * np.minimum(beyond, self.depth)
            closer = (away < self.away) & stepped & (self.labels != label)
            other[closer], self.away[closer] = index[closer], away[closer]
        found = np.isfinite(self.away)
        beyond, far_label = flat[other], self.labels.ravel()[other]
        self.nearer = ~found | (self.depth < beyond)
        through = self.porous & ~self.porous.ravel()[other] & self.nearer
        self.hold = np.where(through, HOLES_REACH / 2, 1) * self.radius
        self.reach = np.where(through, HOLES_REACH, OUTLINE_REACH) * self.radius
        self.mixed = found & (self.away <= self.reach)
        self.front_depth = np.where(self.mixed, np.minimum(self.depth, beyond), self.depth)
        self.behind_depth = np.where(self.mixed, np.maximum(self.depth, beyond), self.depth)
        self.front_label = np.where(self.nearer, self.labels, far_label)
        self.behind_label = np.where(self.nearer, far_label, self.labels)

    def layers(self) -> EdgeLayers:
        radius, mixed = self.radius, self.mixed
        # an outline that is off by the radius leaves nothing certain nearer to it
        certain = np.clip(2 * self.distance / radius - 1.2, 1e-6, 1)
        behind_guide, behind, behind_spread = self._means(self.behind_label, lambda one: certain * (self.labels == one))
        off = ((self.guide - behind_guide) ** 2).sum(-1)
        differs = off**2 / (off**2 + (TELLING / 2 + 2 * behind_spread) ** 2)
        # what differs most is purest; inside the outline its colour counts, outside the less the farther
        prior = np.where(self.nearer, 1, np.clip(1 - self.away / (radius + 1), 0, 1))
        purest = cv2.dilate(off * (mixed & (prior > 0)), np.ones((4 * radius + 1, 4 * radius + 1)))
        by_colour = BY_COLOUR * prior * differs * off / np.maximum(purest, 1e-12)

        def of_front(label):
            own = self.labels == label
            by_outline = certain * own * np.where(self.porous, differs, 1)
            return by_outline + by_colour * (mixed & (self.front_label == label))

        front_guide, front, front_spread = self._means(self.front_label, of_front)
        square = ((front_guide - behind_guide) ** 2).sum(-1)
        axis = front - behind
        along = ((self.photograph - behind) * axis).sum(-1) / np.maximum((axis**2).sum(-1), 1e-300)
        # of values up to 1 the library takes the covariance of three channels for singular
        filtered = cv2.ximgproc.guidedFilter(255 * self.guide, self.nearer.astype(np.float32), max(radius // 3, 1),
                                             255**2 * NOISE)
        share = square**2 / (square**2 + (TELLING + behind_spread + front_spread) ** 2)
        alpha = share * np.clip(along, 0, 1) + (1 - share) * np.clip(filtered, 0, 1)
        # noise and gradients of either side are no mixture
        alpha = np.clip((alpha - UNSURE) / (1 - 2 * UNSURE), 0, 1)
        # far from the outline what was drawn holds, and in a crown's middle holes grow rare
        drawn = _smoothstep((self.away - self.hold) / (self.reach - self.hold))
        alpha = np.where(mixed, alpha * (1 - drawn) + self.nearer * drawn, 1.0)
        front, behind = adding_up(self.photograph, alpha, front, behind)
        return EdgeLayers(alpha, self.front_depth, self.behind_depth, front, behind)

    def _means(self, of_pixel: np.ndarray, weight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Guide (h, w, 3), radiance (h, w, 3) and the guide's variance (h, w) of what `of_pixel` (h, w) names.

        weight(label): how much each pixel (h, w) says of that label. Means are of wider and wider windows, until
        enough lies in one; where nothing does, each pixel is its own mean.
        """
        guide, radiance = self.guide.copy(), self.photograph.copy()
        spread = np.zeros(self.labels.shape, np.float32)
        images = np.concatenate([self.guide, (self.guide**2).sum(-1, keepdims=True), self.photograph,
                                 np.ones_like(self.guide[..., :1])], -1, dtype=np.float32)
        for label in np.unique(of_pixel[self.mixed]):
            asked = self.mixed & (of_pixel == label)
            weights = weight(label).astype(np.float32)[..., None]
            reach = 2 * self.radius
            for last in (False, False, True):
                if not asked.any():
                    break
                part = _around(asked, reach)
                sums = cv2.boxFilter(images[part] * weights[part], -1, (2 * reach + 1, 2 * reach + 1), normalize=False,
                                     borderType=cv2.BORDER_ISOLATED | cv2.BORDER_CONSTANT)
                known = asked[part] & (sums[..., -1] > (1e-9 if last else 2 * BY_COLOUR))
                means = sums[known][:, :-1] / sums[known][:, -1:]
                guide[part][known], radiance[part][known] = means[:, :3], means[:, 4:]
                spread[part][known] = np.maximum(means[:, 3] - (means[:, :3] ** 2).sum(-1), 0)
                asked[part] &= ~known
                reach *= 3
        return guide, radiance, spread


def _around(mask: np.ndarray, margin: int) -> tuple[slice, slice]:
    """The part of an image that holds all of a mask's pixels and `margin` [pixel] round them."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
            slice(max(columns[0] - margin, 0), columns[-1] + margin + 1))


def _smoothstep(x: np.ndarray) -> np.ndarray:
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def _borders(labels: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (H, W) beside one at a clearly different depth, of another region or across a tear within their own.

    And those of the second kind apart, (H, W).
    """
    border, within_one = np.zeros((2, *labels.shape), bool)
    rows = max(1, _BLOCK // labels.shape[1])
    for top in range(0, labels.shape[0], rows):
        # with two rows more on each side, by which a tear is told
        first = max(top - 2, 0)
        far, of = depth[first:top + rows + 2], labels[first:top + rows + 2]
        found = np.zeros((2, *far.shape), bool)
        for axis, a, b in ((1, np.s_[:, 1:], np.s_[:, :-1]), (0, np.s_[1:], np.s_[:-1])):
            apart = np.maximum(far[a], far[b]) > DEPTH_STEP * np.minimum(far[a], far[b])
            same = apart & (of[a] == of[b])
            for kind, step in zip(found, (apart & ~same, same & torn(far, axis) if same.any() else same)):
                kind[a] |= step
                kind[b] |= step
        own = np.s_[top - first:top - first + rows]
        border[top:top + rows], within_one[top:top + rows] = found.any(0)[own], found[1][own]
    return border, within_one


def _distance(mask: np.ndarray) -> np.ndarray:
    """Distance (h, w) [pixel] to the mask."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)


def _nearest(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (h, w) [pixel] to the nearest pixel of the mask, and its index in the flattened image."""
    distance, label = cv2.distanceTransformWithLabels((~mask).astype(np.uint8), cv2.DIST_L2, 5,
                                                      labelType=cv2.DIST_LABEL_PIXEL)
    table = np.zeros(label.max() + 1, int)
    table[label[mask]] = np.flatnonzero(mask)
    return distance, table[label]


def adding_up(photograph, alpha, front, behind) -> tuple[np.ndarray, np.ndarray]:
    """Colours moved as little as may be so that they mix to the photograph, none below 0."""
    a, b = alpha[..., None], 1 - alpha[..., None]
    missing = (photograph - a * front - b * behind) / (a**2 + b**2)
    front, behind = np.maximum(front + a * missing, 0), np.maximum(behind + b * missing, 0)
    mix = a * front + b * behind
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(mix > 0, photograph / mix, 0.0)
    return front * scale, behind * scale
