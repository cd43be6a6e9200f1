"""Templates that are not as the project carries them: what they say must show, so that it is rendered."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from pipeline import paths
from pipeline.plugins.base import Medium
from pipeline.rendering.emit import Templates
from pipeline.scene.placed import PlacedScene

#: Digest of each template as it came, as `sha256sum` writes it; made anew by `make digests`.
DIGESTS = paths.TEMPLATES / "SHA256SUMS"
#: What all renders of T and V are made from, beside the fog's and the light's own.
OF_ALL_RUNS = ("transmittance.pov", "in_scattering.pov", "head.inc", "fog_camera.inc", "fog_lights.inc",
               "fog_scattering.inc")
#: What fog's statements include.
OF_MEDIA = ("media/profile.inc", "media/density_grid.inc")
#: What states how surfaces look; a scene's own may not know how to let green light through.
OF_SURFACES = ("in_scattering.pov", "head.inc", "fog_surfaces.inc", "shapes/planar_faces.inc")


def rendered_for_their_templates(templates: Templates, scene: PlacedScene, medium: Medium) -> list[str]:
    """Lights whose T and V must come from renders although they are known without."""
    common = (*OF_ALL_RUNS, *OF_MEDIA, medium.template_name(), medium.phase().template_name())
    if not _as_they_came(templates, common):
        return list(scene.lights)
    return [name for name, light in scene.lights.items() if not _as_they_came(templates, (light.template_name(),))]


def surfaces_are_ours(templates: Templates, scene: PlacedScene) -> bool:
    """Whether all shapes are stated by the project's own templates, and leave their looks to Fog_Face_Texture."""
    shapes = {shape.template_name() for shape in scene.shapes.values()}
    found = [_first(templates, name) for name in {*OF_SURFACES, *shapes}]
    return all(path is not None and _in_project(path) for path in found) and not any(
        "pigment" in _first(templates, name).read_text(encoding="utf-8") for name in shapes)


def _as_they_came(templates: Templates, names: tuple[str, ...]) -> bool:
    """False where a scene has one of its own, or a person changed the project's; a plugin's from outside is its own."""
    for name in names:
        path = _first(templates, name)
        if path is None:
            continue  # beside a plugin from outside
        if not _in_project(path):
            return False
        if _shipped().get(_carried_name(path)) != _digest(path):
            return False
    return True


def _first(templates: Templates, name: str) -> Path | None:
    return next((folder / name for folder in templates.folders if (folder / name).is_file()), None)


def _in_project(path: Path) -> bool:
    return _carried_name(path) is not None


def _carried_name(path: Path) -> str | None:
    """Like templates/head.inc; None for a file that is not the project's."""
    for folder in (paths.TEMPLATES, paths.INCLUDES):
        if path.is_relative_to(folder):
            return f"{folder.name}/{path.relative_to(folder).as_posix()}"
    return None


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def _shipped() -> dict[str, str]:
    lines = DIGESTS.read_text(encoding="utf-8").splitlines() if DIGESTS.is_file() else []
    return {name: digest for digest, name in (line.split("  ", 1) for line in lines)}
