"""Light strengths by hand."""

from __future__ import annotations

from typing import ClassVar, Literal

from pipeline.plugins.base import Estimator


class Manual(Estimator):
    """Estimates nothing: every light states its own strength."""

    type: Literal["manual"] = "manual"
    estimates: ClassVar[str] = "illumination"
