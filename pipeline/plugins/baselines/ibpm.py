"""Image-based participating media: constant illumination, single scattering by depth."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.optimize import minimize_scalar

from pipeline.physics.constant_light import constant_light_fog, fitted_airlight
from pipeline.plugins.baseline import ClearView, Foggy, OtherFog

#: Densities that are tried, over the fog's own: ln.
LEAST, MOST = np.log(1 / 16), np.log(16)
#: Where the search for the best density starts: too few and it ends in a side valley.
STARTS = 9


class Ibpm(OtherFog):
    """Lopez-Moreno et al. 2008: light of one radiance everywhere, scattered once, by depth; at its best parameters.

    L = L_0 exp(-tau) + A (1 - exp(-tau)), in linear light. A (3,), the constant illumination times the scattered share, is
    fitted per channel, and so is one factor of the fog's density: whichever density is better, its own or the fitted.
    """

    type: Literal["ibpm"] = "ibpm"
    title = "IBPM (Lopez-Moreno et al. 2008)"
    effects = frozenset({"depth", "desaturation", "brightened shadows", "heterogeneous", "metres"})

    def foggy(self, view: ClearView) -> Foggy:
        wanted = view.wanted

        def parts(factor: float) -> tuple[np.ndarray, np.ndarray]:
            """What survives and the share of the airlight, both as large as what is wanted."""
            through = np.exp(-factor * view.optical_depth)
            return wanted.shrunk(view.radiance * through), wanted.shrunk(1 - through)

        def error(logarithm: float) -> float:
            airlight, rest = fitted_airlight(*parts(np.exp(logarithm)), wanted.picture, wanted.counted)
            return rest

        tried = np.linspace(LEAST, MOST, STARTS)
        best = tried[int(np.argmin([error(one) for one in tried]))]
        step = tried[1] - tried[0]
        found = minimize_scalar(error, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-3})
        factor = float(np.exp(found.x)) if found.fun < error(0.0) else 1.0
        airlight, _ = fitted_airlight(*parts(factor), wanted.picture, wanted.counted)
        return Foggy(constant_light_fog(view.radiance, factor * view.optical_depth, airlight),
                     {"airlight": airlight.tolist(), "density_over_the_fogs_own": factor, "fitted_to": wanted.what})
