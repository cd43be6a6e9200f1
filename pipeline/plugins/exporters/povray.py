"""POV-Ray scenes: one file a run, complete in itself."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.plugins.base import Exporter, parameter


class Povray(Exporter):
    """Emits `.pov` files from `templates/`, rendered by POV-Ray 3.7."""

    type: Literal["povray"] = "povray"
    units_per_metre: float | None = parameter(
        None, "1/m", gt=0, le=1e9, allow_inf_nan=False,
        description="POV-Ray units; when left out, such that the scene spans some tens of them")

    def scale(self, extent):
        if self.units_per_metre is not None:
            return self.units_per_metre
        # POV-Ray's tolerances are about 1e-3 of its units, whatever those are
        return float(10.0 ** np.floor(1.5 - np.log10(extent)))
