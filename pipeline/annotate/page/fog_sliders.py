"""The sliders of the fog and of each light's gain: what of the scene they turn, and what the preview tries meanwhile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pipeline.annotate.page.things import Place, at, group

#: Steps of a slider.
STEPS = 1000


@dataclass(frozen=True)
class Slider:
    """name: of the command; place: where its value stands; fog: the preview's name for it, gain: of which light it is.

    The slider runs from 0 to STEPS; ratios are equal along it where it is logarithmic, from `least` to `most`.
    """

    name: str
    label: str
    place: Place
    value: float
    least: float
    most: float
    unit: str = ""
    logarithmic: bool = False
    fog: str = ""
    gain: str = ""
    triple: bool = False

    @property
    def position(self) -> int:
        low, high, value = (self._scaled(x) for x in (self.least, self.most, min(max(self.value, self.least), self.most)))
        return round(STEPS * (value - low) / (high - low))

    def _scaled(self, x: float) -> float:
        return math.log(x) if self.logarithmic else x

    def value_of(self, position: Any) -> float:
        """The value at a position of the slider, to three digits."""
        try:
            share = min(1.0, max(0.0, float(position) / STEPS))
        except (TypeError, ValueError):
            return self.value
        if not math.isfinite(share):
            return self.value
        if self.logarithmic and self.least * 1.0001 > self.value and share == 0:
            return self.least
        low, high = self._scaled(self.least), self._scaled(self.most)
        value = low + share * (high - low)
        return float(f"{math.exp(value) if self.logarithmic else value:.3g}")

    def stored(self, value: float) -> Any:
        """As it stands in the scene."""
        return [value] * 3 if self.triple else value

    def change(self, data: dict, value: float) -> tuple[Place, Any]:
        """Where to set what, for the scene to have this value: a phase function that is not there comes with its type."""
        if self.name == "g" and at(data, self.place[:-1]) is None:
            return self.place[:-1], {"type": "henyey_greenstein", "asymmetry": value}
        return self.place, self.stored(value)

    def tries(self, value: float, fog: dict, gains: dict) -> None:
        """Puts it among what the preview is to try."""
        if self.gain:
            gains[self.gain] = value
        else:
            fog[self.fog] = self.stored(value)


def _number(value: Any, default: float) -> float:
    if isinstance(value, list) and value and all(isinstance(x, (int, float)) for x in value):
        return sum(value) / len(value)
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else default


def sliders(data: dict) -> list[Slider]:
    """Those that this scene's fog and lights have."""
    fog, made = group(data, "fog"), []
    if fog.get("absorption_coefficient") is None and fog.get("type") in ("homogeneous", "height", "layers", "noise", "grid"):
        made.append(Slider("visibility", "Visibility", ("fog", "visibility"), _number(fog.get("visibility"), 30.0), 0.5, 20_000.0, "m",
                           True, fog="visibility"))
        made.append(Slider("albedo", "Albedo", ("fog", "single_scattering_albedo"),
                           _number(fog.get("single_scattering_albedo"), 1.0), 0.0, 1.0, fog="albedo", triple=True))
    if at(fog, ("phase_function", "type"), "henyey_greenstein") == "henyey_greenstein":
        made.append(Slider("g", "Forward scattering g", ("fog", "phase_function", "asymmetry"),
                           _number(at(fog, ("phase_function", "asymmetry")), 0.6), -0.9, 0.9, fog="g"))
    if fog.get("type") == "height":
        made.append(Slider("height", "Scale height", ("fog", "scale_height"), _number(fog.get("scale_height"), 10.0), 0.1, 1000.0, "m",
                           True, fog="height"))
    for name, light in group(data, "lights").items():
        made.append(Slider(f"gain {name}", name, ("lights", name, "gain"), _number(at(light, ("gain",)), 1.0), 0.0, 3.0, gain=name))
    return made


def stated(data: dict) -> tuple[dict[str, Any], dict[str, float]]:
    """The fog's values and the lights' gains of the scene itself, as the preview takes them."""
    fog, gains = {}, {}
    for slider in sliders(data):
        slider.tries(slider.value, fog, gains)
    if "albedo" in fog:
        fog["albedo"] = at(data, ("fog", "single_scattering_albedo"), 1.0)
    if at(data, ("fog", "type")) == "homogeneous":
        fog["height"] = None
    return fog, gains
