"""Sun and sky from shadowed and sunlit patches, after Liu et al. 2009 and Xing et al. 2012."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from pipeline.plugins.base import Estimator, Model, Pixel, Reflectance, mistake, parameter


class GroundPatch(Model):
    """A part of one evenly coloured surface that is all in the sun or all in the shade."""

    pixels: Annotated[list[Pixel], Field(min_length=3, max_length=200)] | None = parameter(
        None, "pixel", description="its outline")
    pixel: Pixel | None = parameter(None, "pixel", description="its middle, with `radius`, instead of `pixels`")
    radius: float = parameter(6.0, "pixel", gt=0, le=1000, description="round `pixel`")
    on: str = parameter("ground", description="plane that it lies on: ground, or an upright region's name")
    albedo: Reflectance | Annotated[float, Field(gt=0, le=1)] | None = parameter(
        None, "1", description="its diffuse albedo; the estimator's when left out")
    sky_visibility: float | None = parameter(
        None, "1", gt=0, le=1, description="share of the sky that houses and trees, taken as black, leave free above it;"
                                           " worked out from the regions when left out, as if nothing"
                                           " stood outside the photograph")

    @model_validator(mode="after")
    def _one_way(self):
        if (self.pixels is None) == (self.pixel is None):
            raise mistake("both 'pixels' and 'pixel' are there" if self.pixels else "no place",
                          "give either 'pixels', an outline, or 'pixel', its middle")
        return self


class LiuXing(Estimator):
    """Skylight from what is in the shade, sunlight from what the sun adds beside it (Zhao et al. 2013, eq. 6)."""

    type: Literal["liu_xing"] = "liu_xing"
    estimates: ClassVar[str] = "illumination"
    shadowed: Annotated[list[GroundPatch], Field(min_length=1, max_length=100)] = parameter(
        description="in the shade, lit by the sky alone; under an overcast sky anywhere")
    sunlit: Annotated[list[GroundPatch], Field(max_length=100)] = parameter(
        [], description="in the sun, of the same surfaces; none under an overcast sky")
    albedo: Reflectance | Annotated[float, Field(gt=0, le=1)] | None = parameter(
        None, "1", description="diffuse albedo of the patches; 0.2, a guess, when left out")
    scale: float = parameter(1.0, "1", gt=0, le=1000, description="the paper's s, on the sky's radiance")
