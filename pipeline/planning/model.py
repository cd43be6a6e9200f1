"""How long a fog's maps take and how far off they are, before any of them is made.

Both are sums over the kinds of work that a scene demands, with constants that `make calibrate` fits to measurements.
Seconds add up; errors of different origin add up in squares.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import paths
from pipeline.errors import InputError
from pipeline.estimation.room_light import DIRECTIONS
from pipeline.planning.demands import GLOW, RENDERED, SHAFT, SINGLE, Demands, LightDemand
from pipeline.rendering.fineness import AREA, INTEGRATED, MIDPOINT, Fineness
from pipeline.rendering.runs import glow_size

#: Constants as measured on one machine; those of this machine stand in the build folder once `make calibrate` ran.
CARRIED = Path(__file__).with_name("calibration.json")
#: Names of the constants of time [s], each of what its name says: of one core where POV-Ray or an integral works.
SECONDS = ("wait", "render", "light_sample", "face", "shaft_sample", "surface_light", "glow_ray", "glow_ray_exponent", "fixed",
           "megapixel", "megapixel_of_light", "full_size_map", "room", "room_direction", "surroundings_ray")
#: Besides V of each light, what is written of a large photograph at its own size: T, V and the foggy photograph.
FULL_SIZE_MAPS = 3
#: Ways of making T without a render, in the order of their factors.
HALF_SHADOWS = (INTEGRATED, MIDPOINT)
#: So many times as far off are a bulb's samples where all of its V is rendered, and not only what shadows take.
WHOLE_PEAK = 4.0
#: What the factors of lights from all sides, for what stands round the fog, are off by where they are made small.
SURROUNDINGS = "surroundings"
#: Laws of error: by which knob's level, and the works whose V each concerns, in shadows that are blurred, in others, or in all.
LAWS: list[tuple[str, str, tuple[str, ...], bool | None]] = [
    ("in_scattering_size", "in_scattering_size", (GLOW, RENDERED), None), (SURROUNDINGS, "in_scattering_size", (), None),
    ("glow_tolerance", "glow_tolerance", (GLOW,), None), ("shadow_size", "shadow_size", (GLOW, SINGLE), True),
    # shadows that nothing blurs are rendered as large as a glow
    ("shadow_size", "in_scattering_size", (SINGLE,), False), ("samples", "samples", (GLOW, RENDERED, SINGLE), True),
    ("shadow_lights", "shadow_lights", (GLOW,), True), ("shaft_samples", "shaft_samples", (SHAFT, SINGLE, RENDERED), False)]


@dataclass(frozen=True)
class Calibration:
    """seconds, error: constants by name; cores: of the machine they were measured on; see `seconds_of` and `error_of`."""

    seconds: dict[str, float]
    error: dict[str, list[float]]
    cores: int
    source: str


def calibration(builds: Path | None = None) -> Calibration:
    """This machine's, where it was measured, else the one that the project carries."""
    own = builds / paths.CALIBRATION if builds else None
    path = own if own is not None and own.is_file() else CARRIED
    try:
        stated = json.loads(path.read_text(encoding="utf-8"))
        if len(stated["error"]["half_shadow"]) != len(HALF_SHADOWS):
            raise ValueError("half_shadow is of another version")
        return Calibration({name: float(stated["seconds"][name]) for name in SECONDS},
                           {k: [float(x) for x in v] for k, v in stated["error"].items()}, int(stated["cores"]), path.name)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"holds no calibration ({error})", place=str(path),
                         remedy="run make calibrate again, or remove the file") from None


def seconds_of(demand: Demands, fineness: Fineness, constants: Calibration) -> float:
    """Wall time [s] from the plan to the foggy photograph."""
    c = constants.seconds
    total, in_povray, renders = c["fixed"] + c["megapixel"] * demand.megapixels + _of_a_room(demand, fineness, c), 0.0, 0
    total += c["full_size_map"] * demand.full_size * (len(demand.lights) + FULL_SIZE_MAPS)
    integrated = 0.0
    for light in demand.lights:
        in_povray += _render_seconds(demand, light, fineness, c)
        renders += 2 * (light.work in (RENDERED, SHAFT)) + 2 * (light.shadows and light.work in (GLOW, SINGLE))
        total += c["megapixel_of_light"] * demand.megapixels
        if light.surrounded:
            integrated += _pixels(demand, fineness.in_scattering_size) * c["surroundings_ray"]
        if light.work == GLOW:
            integrated += _pixels(demand, fineness.in_scattering_size) * _glow_ray(fineness.glow_tolerance, c)
        if fineness.transmittance == AREA and light.surface_lights:
            renders += 2
            megapixels = _pixels(demand, fineness.transmittance_size) / 1e6
            in_povray += c["surface_light"] * (1 + c["face"] * demand.faces) * megapixels * light.surface_lights
    total += (integrated + in_povray + renders * c["render"]) / constants.cores
    return total + (c["wait"] if renders else 0.0)


def _render_seconds(demand: Demands, light: LightDemand, fineness: Fineness, c: dict[str, float]) -> float:
    """Of one core, for what POV-Ray says of a light's V."""
    per_sample = c["light_sample"] * (1 + c["face"] * demand.faces)
    # uneven fog: each sample is lit through as many again
    steps = max(demand.steps, 1)
    through = steps if demand.steps > 1 else 1
    fewest = fewest_samples(demand, fineness)
    side = min(light.side, fineness.shadow_lights)
    if light.work == GLOW and light.shadows:
        lights = light.sub_lights * (side / light.side) ** 2
        return per_sample * _pixels(demand, fineness.shadow_size) * max(fineness.samples, fewest) * lights * through
    if light.work == SINGLE and light.shadows:
        size, samples = ((fineness.shadow_size, fineness.samples) if light.blurred else
                         (fineness.in_scattering_size, fineness.shaft_samples))
        return per_sample * _pixels(demand, size) * max(samples, fewest) * light.sub_lights * through
    if light.work == SHAFT:
        return c["shaft_sample"] * demand.megapixels * 1e6 * max(fineness.shaft_samples, fewest)
    if light.work == RENDERED:
        samples = fineness.samples if light.blurred else fineness.shaft_samples
        return per_sample * _pixels(demand, fineness.in_scattering_size) * max(samples, fewest) * light.sub_lights * through
    return 0.0


def fewest_samples(demand: Demands, fineness: Fineness) -> float:
    """Points along a ray that dense or uneven fog takes, however few are asked for."""
    return max(demand.steps, 1, min(demand.depth, 12.0) / fineness.optical_step)


def level_of(demand: Demands, fineness: Fineness, knob: str) -> float:
    """At what a knob is in effect."""
    level = getattr(fineness, knob)
    return max(level, fewest_samples(demand, fineness)) if knob in ("samples", "shaft_samples") else level


def error_of(demand: Demands, fineness: Fineness, constants: Calibration) -> float:
    """Relative error of the foggy photograph, as `accuracy.relative_error` counts it."""
    return float(np.sqrt(sum(one**2 for one in errors_of(demand, fineness, constants).values())))


def errors_of(demand: Demands, fineness: Fineness, constants: Calibration) -> dict[str, float]:
    """The same by what makes it."""
    squared = dict.fromkeys((knob for _, knob, _, _ in LAWS), 0.0)
    for law, knob, works, blurred in LAWS:
        squared[knob] += (_share(demand, law, works, blurred) * _law(constants, law, level_of(demand, fineness, knob))) ** 2
    return {
        **{knob: float(np.sqrt(one)) for knob, one in squared.items()},
        "transmittance": _half_shadow(demand, fineness, constants), "room_directions": _room(demand, fineness, constants)}


def _half_shadow(demand: Demands, fineness: Fineness, constants: Calibration) -> float:
    way = fineness.transmittance
    if way != AREA:
        return constants.error["half_shadow"][HALF_SHADOWS.index(way)] * demand.half_shadow(way)
    if fineness.transmittance_size >= max(demand.width, demand.height):
        return 0.0
    # a smaller render blurs half-shadows, by which the ways of a lamp's parts differ
    return demand.half_shadow(INTEGRATED) * _law(constants, "transmittance_size", fineness.transmittance_size)


def _of_a_room(demand: Demands, fineness: Fineness, c: dict[str, float]) -> float:
    """Seconds for light of all orders."""
    return c["room"] + c["room_direction"] * fineness.room_directions if demand.reflecting else 0.0


def _room(demand: Demands, fineness: Fineness, constants: Calibration) -> float:
    """What it is off by, against all directions that were found of a room."""
    if fineness.room_directions >= DIRECTIONS:
        return 0.0
    return demand.reflecting * _law(constants, "room_directions", fineness.room_directions)


def concerned(demand: Demands, knob: str, law: str | None = None) -> float:
    """Share of the foggy picture in whose V a knob has a say, by all laws or by one, times what it weighs there."""
    return float(np.linalg.norm([_share(demand, name, works, blurred) for name, of, works, blurred in LAWS
                                 if of == knob and law in (None, name)]))


def _share(demand: Demands, law: str, works: tuple[str, ...], blurred: bool | None) -> float:
    if law == SURROUNDINGS:
        return demand.surrounded()
    if law == "shaft_samples":
        # what is rendered whole has its lamp's own peak to follow too
        whole = demand.share(RENDERED, blurred=False)
        return float(np.hypot(demand.share(SHAFT, SINGLE, blurred=False), WHOLE_PEAK * whole))
    return demand.share(*works, blurred=blurred)


def _law(constants: Calibration, knob: str, level: float) -> float:
    """A power law: factor and exponent of the knob's level."""
    factor, exponent = constants.error[knob]
    return factor * float(level) ** exponent


def _pixels(demand: Demands, longer_side: int) -> int:
    width, height = glow_size(demand.width, demand.height, longer_side)
    return width * height


def _glow_ray(tolerance: float, c: dict[str, float]) -> float:
    """Seconds of one core a ray: a power law of the tolerance."""
    return c["glow_ray"] * tolerance ** c["glow_ray_exponent"]


def demands_as_json(demand: Demands) -> dict[str, Any]:
    return asdict(demand)


def demands_from_json(data: dict[str, Any]) -> Demands:
    return Demands(**{**data, "lights": [LightDemand(**one) for one in data["lights"]]})
