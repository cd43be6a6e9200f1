"""Sun direction from windows and the patches they throw."""

from __future__ import annotations

from typing import ClassVar, Literal

from pipeline.plugins.base import Estimator, parameter


class WindowPatches(Estimator):
    """Minimises the paper's objective: angles to all window-patch directions, minus the image overlap.

    Zhao et al. 2013, section 5.1.
    """

    type: Literal["window_patches"] = "window_patches"
    estimates: ClassVar[str] = "sun_direction"
    starts: int = parameter(6, "1", ge=1, le=100, description="starting directions of the minimisation")
    annotation_noise: float = parameter(
        2.0, "pixel", gt=0, le=100,
        description="how exactly the corners were clicked; sets the confidence cone")
    seed: int = parameter(0, "1", ge=0, description="of the resampling that gives the confidence cone")
