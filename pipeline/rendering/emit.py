"""States a run in POV-Ray's language by the templates.

A run's `.pov` file is complete in itself: includes are written out, so that plain `povray` renders it
from any folder. A scene's own template of the same name wins over the project's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from pipeline import paths
from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.plugins.base import Light, Medium, Plugin
from pipeline.plugins.lights.sun import Sun
from pipeline.rendering.pruning import without_unused_macros
from pipeline.rendering.sandbox import FIXED, BoundedEnvironment, in_time, joined
from pipeline.scene.placed import PlacedScene

MAX_TEMPLATE_BYTES = 1_000_000
#: Optical depth beyond which nothing reaches the eye: exp(-12) is 6e-6 of what is nearer.
FARTHEST_OPTICAL_DEPTH = 12.0
#: Rays across the photograph that tell how far one sees through uneven fog.
SIGHTS = 16


#: Value of a run's `shadows` with which they fall in red alone, and green is as if nothing cast any: two renders in one,
#: where fog is grey.
IN_RED = "in red"


@dataclass(frozen=True)
class Run:
    """One POV-Ray render: which light, what is switched on, how finely.

    kind: irradiance | transmittance | in_scattering | bounce | closure. exposure: the run's values are so
    many times those of the light at unit strength, which keeps half floats in range.
    """

    id: str
    kind: str
    lights: list[str]
    width: int
    height: int
    exposure: float = 1.0
    samples: int = 1
    options: dict[str, Any] = field(default_factory=dict)


class _Compiled(jinja2.BytecodeCache):
    """What templates compile to, by their text, for as long as we run: that takes longer than to fill them in."""

    def __init__(self):
        self.known: dict[tuple[str, str], bytes] = {}

    def load_bytecode(self, bucket):
        if (code := self.known.get((bucket.key, bucket.checksum))) is not None:
            bucket.bytecode_from_string(code)

    def dump_bytecode(self, bucket):
        self.known[bucket.key, bucket.checksum] = bucket.bytecode_to_string()


_COMPILED = _Compiled()


class Templates:
    """Looks templates up: the scene's folder, the project's, then those beside plugins from outside."""

    def __init__(self, scene_folder: Path | None = None):
        self.scene_folder = scene_folder
        own = [scene_folder / "templates", scene_folder] if scene_folder else []
        self.folders = [*own, paths.TEMPLATES, paths.INCLUDES]
        self.plugin_folders: dict[str, Path] = {}
        self.environment = BoundedEnvironment(
            loader=jinja2.FunctionLoader(self._load), undefined=jinja2.StrictUndefined, autoescape=False,
            block_start_string="<%", block_end_string="%>", variable_start_string="<<",
            variable_end_string=">>",
            comment_start_string="<#", comment_end_string="#>", trim_blocks=True, lstrip_blocks=True,
            keep_trailing_newline=True, bytecode_cache=_COMPILED)
        self.environment.filters["vector"] = _vector

    def path_of(self, name: str) -> Path:
        for folder in self.folders:
            if (folder / name).is_file():
                self._refuse_foreign(folder / name)
                return folder / name
        kind, _, file = name.partition("/")
        if name in self.plugin_folders and (self.plugin_folders[name] / file).is_file():
            return self.plugin_folders[name] / file
        raise jinja2.TemplateNotFound(name)

    def _refuse_foreign(self, path: Path) -> None:
        """A link in the scene's folder to a file elsewhere would show that file's text in a `.pov` file."""
        own = self.scene_folder
        if own and path.is_relative_to(own) and not path.resolve().is_relative_to(own.resolve()):
            raise InputError("a template that leads out of the scene's folder", place=str(path),
                             remedy=f"put the file itself into {own}")

    def _load(self, name: str):
        if ".." in Path(name).parts or Path(name).is_absolute():
            raise jinja2.TemplateNotFound(name)
        path = self.path_of(name)
        if path.stat().st_size > MAX_TEMPLATE_BYTES:
            raise InputError(f"template of {path.stat().st_size} bytes", place=str(path),
                             remedy=f"keep it below {MAX_TEMPLATE_BYTES} bytes; {FIXED}")
        # the marker lets an error of POV-Ray be traced back to the template
        return f"// ---- {_shown(path)}\n" + path.read_text(encoding="utf-8"), str(path), lambda: True

    def render(self, name: str, context: dict[str, Any]) -> str:
        """The template's text; a mistake in it is one line with file and line."""
        try:
            with in_time(name):
                return joined(self.environment.get_template(name).generate(context), name)
        except jinja2.TemplateSyntaxError as error:
            # the marker is line 1 of what Jinja read
            raise InputError(f"template does not parse ({error.message})",
                             place=f"{error.filename}:{error.lineno - 1}",
                             remedy="mend this line") from None
        except jinja2.TemplateNotFound as error:
            raise InputError(f"no template '{error.name}'", place=_template_place(error) or name,
                             remedy="put it into templates/ or the scene's folder") from None
        except InputError:
            raise
        except Exception as error:  # a template may fail in any way; a failure outside templates is ours
            place = _template_place(error)
            if place is None:
                raise
            raise InputError(f"template fails ({error})", place=place,
                             remedy="use the values that are there") from None

    def of_plugin(self, plugin: Plugin, context: dict[str, Any]) -> str:
        self.plugin_folders[plugin.template_name()] = plugin.template_folder()
        parameters = {name: getattr(plugin, name) for name in type(plugin).model_fields}
        return self.render(plugin.template_name(), {**context, **parameters, **plugin.statement()})


def emit(run: Run, scene: PlacedScene, templates: Templates, *, medium: Medium | None = None,
         albedos: list[list[float]] | None = None, strengths: dict[str, list[float]] | None = None) -> str:
    """The `.pov` text of one run."""
    camera, extent = scene.camera, scene.extent()
    if "along" not in run.options and (run.width, run.height) != (camera.width, camera.height):
        camera = camera.resized(run.width, run.height)
    shafts = any(isinstance(scene.lights[name], Sun) for name in run.lights)
    facts = {"id": run.id, "kind": run.kind, "light": ", ".join(run.lights), "width": run.width,
             "height": run.height,
             "exposure": run.exposure, "samples": run.samples, "shafts": shafts,
             "scatters": not shafts and all(scene.lights[name].light_source for name in run.lights),
             "along": None,
             **run.options}
    context: dict[str, Any] = {"run": facts, "channels": [], "bounds": {
        "lowest": float(camera.position[1] - 4 * extent), "highest": float(camera.position[1] + 4 * extent)}}
    backdrop = 2 * extent
    blocks = {"medium": ""}
    if medium is not None:
        absorption, scattering = medium.coefficients()
        extinction = absorption + scattering
        context["channels"] = _channels(extinction)
        blocks["medium"] = templates.of_plugin(medium.phase(), context) + templates.of_plugin(
            medium, {**context, "absorption": absorption.tolist(), "scattering": scattering.tolist()})
        if run.kind == "in_scattering" and extinction.min() > 0:
            backdrop = min(backdrop, farthest_seen(scene, medium))
    index, statements, in_red = 0, [], []
    for name, shape in scene.shapes.items():
        faces = []
        for face, corners in shape.faces().items():
            faces.append({"name": f"{name}.{face}", "corners": corners.tolist(), "index": index})
            index += 1
        text = templates.of_plugin(shape, {**context, "name": name, "faces": faces})
        shadows = run.options.get("shadows", True) if shape.casts_shadow else False
        statements.append(text if shadows is True else _without_shadow(text))
        if shadows == IN_RED:
            # seen by light alone; hollow, for what lies in it is fog to the light that goes through
            in_red.append(text)
    if in_red:
        statements.append("#declare Fog_Look = 3;\nunion {\n" + "\n".join(in_red) + "\nno_image hollow\n}\n")
    blocks["shapes"] = "\n".join(statements)
    lights = []
    for name in run.lights:
        exposure = np.multiply(strengths[name], run.exposure).tolist() if strengths else run.exposure
        light_facts = {**facts, "exposure": _vector(exposure) if strengths else exposure}
        if strengths:
            lights.append("#ifdef (Fog_Exposure) #undef Fog_Exposure #end")
        lights.append(templates.of_plugin(stated_light(run, scene, name), {**context, "run": light_facts, "name": name}))
    blocks["lights"] = "\n".join(lights)
    return without_unused_macros(templates.render(f"{run.kind}.pov", {
        **context, "blocks": blocks, "albedos": albedos or [],
        "metre": scene.exporter.scale(extent), "extent": 4 * extent, "backdrop": backdrop,
        "camera": {
            "position": camera.position, "right": camera.world_from_camera[:, 0],
            "down": camera.world_from_camera[:, 1],
            "forward": camera.world_from_camera[:, 2], "focal_length": camera.focal_length,
            "principal_point": camera.principal_point, "width": camera.width, "height": camera.height}}))


def stated_light(run: Run, scene: PlacedScene, name: str) -> Light:
    """The light as the run states it: all of it, the part whose shadows are worth a render, or by finer parts."""
    light = scene.lights[name]
    if "shadows" in run.options:
        light = light.shaded_part(scene.camera.position)
    if "shadow_lights" in run.options:
        light = light.coarser(run.options["shadow_lights"])
    return light.finer(*run.options["finer"]) if "finer" in run.options else light


def write_side_files(folder: Path, medium: Medium) -> list[str]:
    """Puts the files that the medium's statement reads beside the `.pov` files of `folder`; their names."""
    files = medium.side_files()
    for name, data in files.items():
        path = folder / paths.checked_name(name, "side file")
        if not path.exists() or path.read_bytes() != data:
            with replacing(path) as partial:
                partial.write_bytes(data)
    return list(files)


def farthest_seen(scene: PlacedScene, medium: Medium) -> float:
    """Distance [m] beyond which the fog lets nothing through to the eye; twice the scene's radius at most."""
    extinction, longest = float(np.add(*medium.coefficients()).min()), 2 * scene.extent()
    if not extinction > 0:
        return longest
    if medium.render_step() == np.inf:
        return min(longest, FARTHEST_OPTICAL_DEPTH / extinction)
    camera = scene.camera.resized(SIGHTS, SIGHTS)
    directions = camera.directions(camera.pixel_centres())
    # halving: what is seen clearly lies far beyond what lies in fog
    distances = longest * 2.0 ** np.arange(-20, 1)
    paths = medium.density_along(camera.position, directions, np.broadcast_to(
        distances, (*directions.shape[:-1], len(distances))))
    through = (extinction * paths < FARTHEST_OPTICAL_DEPTH).any(axis=(0, 1))
    return float(distances[min(int(through.sum()), len(distances) - 1)])


def _channels(extinction: np.ndarray) -> list[dict[str, Any]]:
    """Channels of equal extinction together, as masks."""
    return [{"extinction": float(value), "mask": (extinction == value).astype(float).tolist()}
            for value in sorted(set(extinction.tolist()))]


def _without_shadow(text: str) -> str:
    return f"union {{\n{text}\nno_shadow\n}}\n"


def _vector(values: Any) -> str:
    return "<" + ",".join(repr(float(v)) for v in values) + ">"


def _shown(path: Path) -> str:
    try:
        return str(path.resolve().relative_to(paths.PROJECT))
    except ValueError:
        return str(path)


def _template_place(error: BaseException) -> str | None:
    traceback, place = error.__traceback__, None
    while traceback is not None:
        file = traceback.tb_frame.f_code.co_filename
        if file.endswith((".inc", ".pov")):
            place = f"{file}:{max((traceback.tb_lineno or 1) - 1, 1)}"
        traceback = traceback.tb_next
    return place
