"""What weather services call a visibility."""

from __future__ import annotations

import numpy as np

#: Contrast to which a visibility is the distance, WMO's meteorological optical range.
CONTRAST = 0.05
#: Names of visibilities [m] below so many metres.
CLASSES = ((50.0, "dense fog"), (200.0, "thick fog"), (500.0, "moderate fog"), (1000.0, "light fog"), (5000.0, "mist"),
           (10000.0, "haze"), (np.inf, "clear air"))


def visibility(extinction: np.ndarray) -> float:
    """Meteorological optical range [m] of an extinction_coefficient (3,) [1/m], over the channels' mean."""
    with np.errstate(divide="ignore"):
        return float(-np.log(CONTRAST) / np.mean(extinction))


def visibility_class(metres: float) -> str:
    """Dense, thick, moderate or light fog, mist, haze, or clear air.

    Fog is a visibility below 1 km (WMO-No. 8 and the International Cloud Atlas, WMO-No. 407; METAR: FG), mist one of
    1 to 5 km (ICAO Annex 3, METAR: BR), and above 10 km METAR says CAVOK. Within fog the International Visibility Code
    (Hulburt 1941) has dense below 50 m, thick to 200 m, moderate to 500 m and light to 1 km; national services put
    the borders elsewhere.
    """
    return next((name for below, name in CLASSES if metres < below), CLASSES[-1][1])
