"""A baseline of three lines: everything is as grey."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.plugins.baseline import ClearView, Foggy, OtherFog


class Grey(OtherFog):
    """The photograph's mean, everywhere."""

    type: Literal["grey"] = "grey"
    title = "Grey"
    effects = frozenset({"brightened shadows"})

    def foggy(self, view: ClearView) -> Foggy:
        return Foggy(np.broadcast_to(view.radiance.mean((0, 1)), view.radiance.shape), {"pixels": view.radiance[..., 0].size})
