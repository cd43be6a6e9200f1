"""Sun direction from upright things and their shadows."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pipeline.plugins.base import Estimator, Model, Pixel, parameter


class CastShadow(Model):
    """Something upright on level ground, and its shadow."""

    foot: Pixel = parameter(unit="pixel", description="where it stands on the ground")
    tip: Pixel = parameter(unit="pixel", description="its top")
    shadow: Pixel = parameter(unit="pixel", description="where its top's shadow falls on the ground")


class CastShadows(Estimator):
    """The direction that throws the tops of posts, people, houses to where their shadows end."""

    type: Literal["cast_shadow"] = "cast_shadow"
    estimates: ClassVar[str] = "sun_direction"
    shadows: Annotated[list[CastShadow], Field(min_length=1, max_length=100)] = parameter(
        description="one or more; several are fitted together")
    annotation_noise: float = parameter(
        2.0, "pixel", gt=0, le=100, description="how exactly the points were clicked; sets the confidence cone")
    seed: int = parameter(0, "1", ge=0, description="of the resampling that gives the confidence cone")
