"""Henyey-Greenstein phase function."""

from typing import Literal

import numpy as np

from pipeline.plugins.base import PhaseFunction, parameter


class HenyeyGreenstein(PhaseFunction):
    """One lobe of adjustable forwardness (Henyey and Greenstein 1941)."""

    type: Literal["henyey_greenstein"] = "henyey_greenstein"
    asymmetry: float = parameter(
        0.6, "1", ge=-0.999, le=0.999, allow_inf_nan=False,
        description="mean cosine g: 0 scatters evenly, 0.6 is light mist, 0.9 dense fog; > 0 forward",
    )

    def value(self, cosine):
        # (1-|g|)^2 + 2|g|(1 - cos to the peak) does not cancel near it, where 1 + g^2 - 2g cos loses all digits.
        g = abs(self.asymmetry)
        squared = (1 - g) ** 2 + 2 * g * (1 - np.copysign(1.0, self.asymmetry) * np.asarray(cosine, float))
        return (1 - g) * (1 + g) / (4 * np.pi * squared * np.sqrt(squared))
