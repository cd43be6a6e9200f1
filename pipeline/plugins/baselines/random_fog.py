"""`RandomFog` of the augmentation library albumentations."""

from __future__ import annotations

import os
from typing import Literal

import numpy as np

from pipeline.plugins.baseline import ClearView, Foggy, OtherFog

SEED = 1


class RandomFog(OtherFog):
    """albumentations' RandomFog at its defaults: pale discs laid over the picture, then a blur; it knows no depth."""

    type: Literal["random_fog"] = "random_fog"
    title = "albumentations RandomFog"
    package = "albumentations"
    effects = frozenset()

    def foggy(self, view: ClearView) -> Foggy:
        os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # it asks the network for a newer version otherwise
        import albumentations

        transform = albumentations.Compose([albumentations.RandomFog(p=1.0)], seed=SEED)
        return Foggy(transform(image=np.ascontiguousarray(view.encoded))["image"],
                     {"version": albumentations.__version__, "seed": SEED})
