"""Sun direction from date, time and place."""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, Literal

from pydantic import StringConstraints, model_validator

from pipeline.plugins.base import Estimator, mistake, parameter


class SolarPosition(Estimator):
    """Where the sun stood when the photograph was taken."""

    type: Literal["solar_position"] = "solar_position"
    estimates: ClassVar[str] = "sun_direction"
    time: Annotated[str, StringConstraints(max_length=40)] = parameter(
        description="local date and time, like '2024-06-21 17:30'")
    time_zone: Annotated[str, StringConstraints(min_length=1, max_length=60)] = parameter(
        description="name such as Europe/Berlin, or an offset such as +02:00")
    latitude: float = parameter(unit="degree", ge=-90, le=90, description="north is positive")
    longitude: float = parameter(unit="degree", ge=-180, le=180, description="east is positive")
    heading: float = parameter(unit="degree", ge=-360, le=360, allow_inf_nan=False,
                               description="compass bearing of the photograph's centre, clockwise from true north")

    @model_validator(mode="after")
    def _date_and_time(self):
        if not re.fullmatch(r"\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}(:\d{2})?", self.time):
            raise mistake(f"'{self.time}' is no date and time", "write it like '2024-06-21 17:30'", at=("time",))
        return self
