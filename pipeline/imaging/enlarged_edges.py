"""Borders between near and far regions of a large photograph, from those refined at a smaller size.

Colours and depths of the two layers are smooth and enlarged; the share of the layer in front follows the photograph, along
the line between the two colours, by as much as that is sharper than its smaller copy (as in guided upsampling, Kopf et al.
2007; He et al. 2013).
"""

from __future__ import annotations

import numpy as np

from pipeline.imaging.edges import TELLING, EdgeLayers, adding_up
from pipeline.physics.enlarging import bilinear, centres

#: Depths that differ by this share are not averaged.
SAME_DEPTH = 0.05
#: Slope by which the share takes the photograph's detail, from 0 or 1 on.
FOLLOWING = 8.0


class EnlargedEdges:
    """Layers as `edges.refined` with mixed_only, at the size (H, W) of a photograph, some rows at a time.

    small: layers (h, w) of the smaller photograph (h, w, 3), without those of the scene's own shapes.
    """

    def __init__(self, small: EdgeLayers, photograph: np.ndarray, size: tuple[int, int]):
        self.small, self.size = small, size
        self.edged = small.front_depth != small.behind_depth
        layers = [small.alpha[..., None], small.front_depth[..., None], small.behind_depth[..., None], small.front,
                  small.behind, np.maximum(photograph, 0)]
        self.values = np.concatenate([np.ones((*self.edged.shape, 1)), *layers], -1, dtype=np.float32)
        self.values *= self.edged[..., None]
        self.white = max(float(np.percentile(photograph.max(-1), 99.5)), 1e-30)
        self.y, self.x = centres(size, self.edged.shape)

    def rows(self, top: int, bottom: int, photograph: np.ndarray) -> EdgeLayers:
        """Layers of these rows of the photograph (n, W, 3)."""
        shape = photograph.shape[:2]
        found = EdgeLayers(np.ones(shape, np.float32), *(np.zeros((*shape, *more), np.float32)
                                                         for more in ((), (), (3,), (3,))))
        nearest = np.ix_(*(np.clip(np.rint(at), 0, few - 1).astype(int)
                           for at, few in zip((self.y[top:bottom], self.x), self.edged.shape)))
        at = np.nonzero(self.edged[nearest])
        if not len(at[0]):
            return found
        values = bilinear(self.values, self.y[top:bottom], self.size[1])[at]
        values = values[:, 1:] / np.maximum(values[:, :1], 1e-6)
        for depth, value, of in ((found.front_depth, values[:, 1], self.small.front_depth),
                                 (found.behind_depth, values[:, 2], self.small.behind_depth)):
            one = of[nearest][at]
            depth[at] = np.where(np.abs(value - one) <= SAME_DEPTH * one, value, one)
        alpha, (front, behind, blurred) = values[:, 0], np.split(values[:, 3:], 3, axis=1)
        own = np.maximum(photograph[at], 0)
        axis = front - behind
        detail = ((own - blurred) * axis).sum(-1) / np.maximum((axis**2).sum(-1), 1e-30)
        shown = [np.sqrt(np.clip(colour / self.white, 0, 1)) for colour in (front, behind)]
        square = ((shown[0] - shown[1]) ** 2).sum(-1)
        share = square**2 / (square**2 + TELLING**2) * np.minimum(1, FOLLOWING * alpha * (1 - alpha))
        alpha = np.clip(alpha + share * np.clip(detail, -1, 1), 0, 1)
        found.alpha[at] = alpha
        found.front[at], found.behind[at] = adding_up(own, alpha, front, behind)
        return found
