"""How finely a fog's maps are made: the knobs that trade time for accuracy, and nothing else."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from pipeline.errors import InputError

#: What is known of T: by what a render of the lamp's area shows; by the same area integrated without a render, nothing
#: standing between; by its middle alone (Zhao et al. 2013, eq. 5).
AREA, INTEGRATED, MIDPOINT = "area", "integrated", "midpoint"


@dataclass(frozen=True)
class Fineness:
    """Sizes are of the longer side [pixel]; a photograph that is smaller has its own.

    in_scattering_size: of the glow of lamps. glow_tolerance: relative change at which its quadrature stops.
    shadow_size: of what renders say that shadows take from it. samples: points along each ray of those.
    shadow_lights: side of the grid of small lights that stands for an area light in them, at most.
    shaft_samples: points along a ray inside a shaft, or in the glow of a single lamp, whose shadows nothing blurs.
    optical_step: most optical depths between two of those points; density_steps: most of them where a fog's density
    varies. transmittance: AREA, INTEGRATED or MIDPOINT. transmittance_size: of its renders. transmittance_step: most
    optical depths that a small part of a lamp may span for T. room_directions: along which points in a room see what
    light of all orders comes from.
    """

    in_scattering_size: int = 256
    glow_tolerance: float = 5e-3
    shadow_size: int = 128
    samples: int = 24
    shadow_lights: int = 32
    shaft_samples: int = 72
    optical_step: float = 1 / 3
    density_steps: int = 128
    transmittance: str = AREA
    transmittance_size: int = 20000
    transmittance_step: float = 0.05
    room_directions: int = 128

    def stated(self, settings: dict[str, Any]) -> "Fineness":
        """The same, but as a scene's render settings state it where they do."""
        own = {one.name: settings[one.name] for one in fields(self) if settings.get(one.name) is not None}
        if "samples" in own and "shaft_samples" not in own:
            own["shaft_samples"] = 3 * own["samples"]
        return replace(self, **own)


def as_json(fineness: Fineness) -> dict[str, Any]:
    return asdict(fineness)


def from_json(data: dict[str, Any]) -> Fineness:
    try:
        return Fineness(**data)
    except TypeError as error:
        raise InputError(f"its fineness is not as this version of the pipeline plans it ({error})", place="plan.json",
                         remedy="remove the scene's build folder and run make again") from None
