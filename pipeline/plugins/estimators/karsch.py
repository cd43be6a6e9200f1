"""Light strengths from the photograph, after Karsch et al. 2011."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pipeline.plugins.base import Estimator, Model, Pixel, Reflectance, parameter


class AnnotatedAlbedo(Model):
    """A region of the photograph whose diffuse albedo is known."""

    pixels: Annotated[list[Pixel], Field(min_length=3, max_length=200)] = parameter(
        unit="pixel", description="outline of the region")
    albedo: Reflectance = parameter(unit="1", description="its diffuse albedo per channel")


class Karsch(Estimator):
    """Renders each light alone over the estimated geometry and fits their sum to the photograph.

    Albedo and strength share one scale. An annotated albedo, a visible lamp that is not clipped or a strength
    given by hand fixes it; otherwise `default_albedo` does.
    """

    type: Literal["karsch"] = "karsch"
    estimates: ClassVar[str] = "illumination"
    albedos: Annotated[list[AnnotatedAlbedo], Field(max_length=100)] = parameter(
        [], description="regions of known albedo; these win over what the photograph suggests")
    default_albedo: float = parameter(0.5, "1", gt=0, lt=1,
                                      description="mean albedo where nothing else sets the scale")
    size: int = parameter(160, "pixel", ge=16, le=2000,
                          description="longer side of the renders that are fitted")
    bounces: int = parameter(3, "1", ge=0, le=6,
                             description="depth of interreflection; 0 is direct light only")
    rounds: int = parameter(2, "1", ge=1, le=6,
                            description="times that albedo and interreflection are refined")
    rays: int = parameter(60, "1", ge=1, le=1600,
                          description="that gather bounced light at each point, half as many in rounds before the last; four"
                                      " times as many take four times as long and change no strength in bathroom by more"
                                      " than 3 %")
