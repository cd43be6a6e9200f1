"""The fog of the "common corruptions" benchmark, by the package imagecorruptions."""

from __future__ import annotations

import warnings
from importlib.metadata import version
from typing import Literal
from unittest import mock

import numpy as np

from pipeline.plugins.baseline import ClearView, Foggy, OtherFog

SEED, SEVERITY = 1, 3
#: Shorter sides [pixel] it refuses.
SMALLEST = 32


class CommonCorruptions(OtherFog):
    """Hendrycks and Dietterich 2019, severity 3 of 5: a plasma fractal added to the picture; it knows no depth."""

    type: Literal["common_corruptions"] = "common_corruptions"
    title = "imagecorruptions fog, severity 3"
    package = "imagecorruptions"
    effects = frozenset()

    def foggy(self, view: ClearView) -> Foggy:
        codes, (height, width) = view.encoded, view.encoded.shape[:2]
        around = [(0, max(0, SMALLEST - height)), (0, max(0, SMALLEST - width)), (0, 0)]
        state = np.random.get_state()
        np.random.seed(SEED)  # it draws from NumPy's own generator
        try:
            # written for NumPy 1: it names a type that NumPy 2 has no more
            with warnings.catch_warnings(), mock.patch.object(np, "float_", np.float64, create=True):
                warnings.simplefilter("ignore")
                import imagecorruptions

                picture = imagecorruptions.corrupt(np.pad(codes, around, "edge"), severity=SEVERITY, corruption_name="fog")
        finally:
            np.random.set_state(state)
        return Foggy(picture[:height, :width], {"version": version("imagecorruptions"), "seed": SEED, "severity": SEVERITY})
