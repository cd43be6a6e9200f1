"""Fog, lights and geometry -> plan.json: which renders are needed, how fine, and why."""

from __future__ import annotations

from pipeline import paths
from pipeline.errors import InputError
from pipeline.paths import Build
from pipeline.physics.bulbs import UNSEEN
from pipeline.plugins.base import Medium
from pipeline.rendering.emit import Run, Templates
from pipeline.rendering.runs import (MOST_SAMPLES, MOST_SHADED, SHADED, SHADOWS, as_json, dense_samples, fog_runs, hidden,
                                     shaded_lights, uneven_samples)
from pipeline.rendering.work import refuse_too_much
from pipeline.scene.artefacts import read_fog, read_json, read_placed, scene_place, write_json
from pipeline.scene.placed import PlacedScene


def run(build: Build) -> None:
    scene, medium = read_placed(build), read_fog(build)
    settings = read_json(build.input("render"))
    lights: list[str] = []
    runs: list[Run] = []
    if medium.is_clear():
        reasons = ["the fog extinguishes nothing: no render, the photograph comes back unchanged"]
    else:
        strengths = {name: max(light["strength"])
                     for name, light in read_json(build.illumination)["lights"].items()}
        bright = [name for name in scene.lights if strengths[name] > 0]
        lights = [name for name in bright if not hidden(scene, medium, name)]
        shaded = shaded_lights(scene, {name: strengths[name] for name in lights})
        runs = fog_runs(scene, medium, lights, settings["samples"], settings["in_scattering_size"], shaded,
                        settings["transmittance"] == "midpoint", settings["transmittance_step"],
                        lights if settings["glow"] == "rendered" else _of_own_template(build, scene),
                        settings["shadow_size"], _surfaces_are_ours(build, scene))
        try:
            refuse_too_much(scene, runs, settings["max_light_samples"])
        except InputError as error:
            raise error.at(scene_place(build, "render")) from None
        reasons = [f"{name}: strength 0, no render" for name in scene.lights if name not in bright]
        reasons += [f"{name}: left out, behind {UNSEEN:g} optical depths of fog" for name in bright if name not in lights]
        reasons += reasons_for(scene, medium, lights, runs, settings["samples"])
    write_json(build.plan, {
        "fog_is_clear": medium.is_clear(), "lights": lights, "runs": [as_json(r) for r in runs],
        "reasons": reasons})


def _of_own_template(build: Build, scene: PlacedScene) -> list[str]:
    """Lights that the scene states by a template of its own: what that says must show."""
    own = [folder for folder in Templates(build.source).folders if folder not in (paths.TEMPLATES, paths.INCLUDES)]
    return [name for name, light in scene.lights.items() if any((folder / light.template_name()).is_file() for folder in own)]


#: What states how surfaces look; a scene's own may not know how to let green light through.
SURFACES = ("in_scattering.pov", "head.inc", "fog_surfaces.inc", "shapes/planar_faces.inc")


def _surfaces_are_ours(build: Build, scene: PlacedScene) -> bool:
    """Whether all shapes are stated by the project's own templates, and leave their looks to Fog_Face_Texture."""
    shapes = {shape.template_name() for shape in scene.shapes.values()}
    folders = Templates(build.source).folders
    first = {name: next((folder for folder in folders if (folder / name).is_file()), None) for name in {*SURFACES, *shapes}}
    return all(folder in (paths.TEMPLATES, paths.INCLUDES) for folder in first.values()) and not any(
        "pigment" in (first[name] / name).read_text(encoding="utf-8") for name in shapes)


def reasons_for(scene: PlacedScene, medium: Medium, lights: list[str], runs: list[Run], samples: int
                ) -> list[str]:
    """Why the runs are these and no others, one line a choice."""
    reasons = []
    for name in lights:
        count = scene.lights[name].hidden_count(medium, scene.camera.position)
        if count and not scene.rendered(name):
            reasons.append(f"{name}: {count} of {scene.lights[name].sub_light_count()} lamps left out, behind {UNSEEN:g}"
                           " optical depths of fog")
        kinds = [kind for kind in (SHADED, SHADOWS) if any(one.id == f"{kind}_{name}" for one in runs)]
        if kinds:
            reasons.append(shadow_reason(scene, name, SHADOWS in kinds))
        elif scene.shaded(name) and medium.coefficients()[1].max() > 0:
            reasons.append(f"{name}: V without shadows, by quadrature; only the {MOST_SHADED} brightest lamps have theirs"
                           " rendered")
        elif not scene.rendered(name):
            reasons.append(f"{name}: known in closed form, no render")
        if scene.rendered(name) and f"transmittance_{name}" not in {one.id for one in runs}:
            reasons.append(f"{name}: T by the light's midpoint, no render")
        if f"clear_{name}" in {one.id for one in runs}:
            reasons.append(f"{name}: smaller parts of it for T, for the fog is dense and its half-shadows wide")
    if not medium.coefficients()[1].max() > 0:
        reasons.append("the fog scatters nothing: no in-scattering renders, V = 0")
    if not scene.outdoors and not any(light.type == "sun" for light in scene.lights.values()):
        reasons.append("no sun: no shaft")
    for one in runs:
        if one.kind != "in_scattering" or "shadows" in one.options:
            continue
        name, = one.lights
        if one.width < scene.camera.width:
            reasons.append(f"{name}: glow at {one.width}x{one.height}, for it is smooth; edges of depth are kept")
        if one.samples > samples and one.samples == uneven_samples(scene, medium, one.kind):
            few = one.samples == MOST_SAMPLES[one.kind]
            reasons.append(f"{name}: {one.samples} samples instead of {samples}: steps that follow how the fog"
                           " varies" + (", as nearly as is affordable" if few else ""))
        elif one.samples > samples and one.samples == dense_samples(scene, medium):
            reasons.append(f"{name}: {one.samples} samples instead of {samples}: dense fog, a third of an"
                           " optical depth each")
        elif one.samples > samples:
            reasons.append(f"{name}: {one.samples} samples instead of {samples}: few lights, whose shadow"
                           " edges nothing blurs")
    return reasons


def shadow_reason(scene: PlacedScene, name: str, in_one: bool) -> str:
    light = scene.lights[name]
    part, count = light.shaded_part(scene.camera.position), light.sub_light_count()
    few = f" of the {part.sub_light_count()} strongest of {count}" if part is not light else ""
    renders = "a small render tells" if in_one else "two small renders tell"
    return f"{name}: V without shadows by quadrature; {renders} what shadows{few} take from it"
