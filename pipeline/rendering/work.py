"""How much POV-Ray would have to do, told before it does it."""

from __future__ import annotations

from pipeline.errors import InputError
from pipeline.rendering.emit import Run, stated_light
from pipeline.scene.placed import PlacedScene


def light_samples(scene: PlacedScene, run: Run) -> float:
    """Points that a run lights: pixels, samples along the ray, and the small lights that stand for its lights."""
    lights = sum(stated_light(run, scene, name).sub_light_count() for name in run.lights)
    return float(run.width) * run.height * run.samples * lights


def refuse_too_much(scene: PlacedScene, runs: list[Run], limit: float) -> None:
    """Raises InputError where the runs together light more points than `limit`."""
    work = {run.id: light_samples(scene, run) for run in runs}
    total = sum(work.values())
    if total > limit:
        most = max(work, key=work.get)
        raise InputError(f"POV-Ray would have to light {total:.2g} points, most of them in {most}; the limit is {limit:.2g}",
                         remedy="lower sub_lights, render.samples or render.in_scattering_size, or raise"
                                " render.max_light_samples")
