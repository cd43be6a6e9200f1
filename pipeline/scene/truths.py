"""Truths that a scene carries: its own model in fog, rendered when the scene was made."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.imaging.maps import read_metadata
from pipeline.plugins.base import Medium

#: Coefficients and asymmetry that differ by no more than this, as a share, are of one fog.
SAME_FOG = 1e-5


def is_of(path: Path, medium: Medium) -> bool:
    """Whether a truth's metadata say that it is of this fog, which then is an even one."""
    metadata = read_metadata(path)
    stated = [metadata.get(f"fog:{name}_coefficient_per_m", np.nan) for name in ("absorption", "scattering")]
    stated.append(metadata.get("fog:asymmetry", 0.0 if metadata.get("fog:phase_function") == "isotropic" else np.nan))
    wanted = [*medium.coefficients(), getattr(medium.phase(), "asymmetry", 0.0)]
    return medium.even and all(np.allclose(one, other, rtol=SAME_FOG, atol=1e-9) for one, other in zip(stated, wanted))
