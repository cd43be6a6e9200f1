"""What fogs have in common that are stated by visibility or by coefficients."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator
from typing_extensions import Annotated

from pipeline.plugins.base import Colour, Medium, mistake, parameter
from pipeline.plugins.choices import PhaseFunctionChoice

CONTRAST_OF = {"meteorological_optical_range": 0.05, "koschmieder": 0.02}
Albedo = Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=3, max_length=3)]


class DenseMedium(Medium):
    """Fog by its visibility or its coefficients, which hold where the relative density is 1."""

    visibility: Annotated[float, Field(ge=1e-3)] | None = parameter(
        None, "m",
        description="distance at which a dark object's contrast falls to `contrast`; .inf is no fog")
    contrast: Literal["meteorological_optical_range", "koschmieder"] = parameter(
        "meteorological_optical_range",
        description="what visibility means: contrast 0.05 (WMO) or 0.02 (Koschmieder)")
    single_scattering_albedo: Albedo = parameter(
        [1.0, 1.0, 1.0], "1",
        description="share of the extinction that is scattered, per channel; with `visibility`")
    absorption_coefficient: Colour | None = parameter(None, "1/m", description="instead of `visibility`")
    scattering_coefficient: Colour | None = parameter(None, "1/m", description="instead of `visibility`")
    phase_function: PhaseFunctionChoice = parameter(
        {"type": "henyey_greenstein"}, description="how it scatters")

    @model_validator(mode="after")
    def _one_way(self):
        by_coefficients = (self.absorption_coefficient, self.scattering_coefficient)
        if self.visibility is not None and by_coefficients != (None, None):
            raise mistake("both 'visibility' and a coefficient are there",
                          "keep either 'visibility' or the two coefficients")
        if self.visibility is None and None in by_coefficients:
            raise mistake("nothing says how dense it is",
                          "give 'visibility' [m], or both 'absorption_coefficient' and"
                          " 'scattering_coefficient' [1/m]")
        told = {"contrast": self.contrast, "single_scattering_albedo": self.single_scattering_albedo}
        for name, value in told.items() if self.visibility is None else ():
            if value != type(self).model_fields[name].default:
                raise mistake(f"{name} has no meaning beside coefficients", "leave it out", at=(name,))
        return self

    def coefficients(self):
        if self.visibility is None:
            return np.array(self.absorption_coefficient, float), np.array(self.scattering_coefficient, float)
        # kappa = -ln(contrast) / visibility (Koschmieder's law; contrast 0.05 is WMO's definition)
        extinction = -np.log(CONTRAST_OF[self.contrast]) / self.visibility
        scattering = extinction * np.array(self.single_scattering_albedo, float)
        return extinction - scattering, scattering
