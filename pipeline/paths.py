"""Every file name of the project stands here.

build/SCENE/ holds what belongs to the photograph (camera, geometry, light) and the results of the scene's
default fog; build/SCENE/FOG/ holds the results of the fog called FOG. Of a photograph larger than its working size,
images of that size lie in working/ below these folders, under the names of the full-size ones.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.errors import InputError

PROJECT = Path(__file__).resolve().parent.parent
TEMPLATES = PROJECT / "templates"
INCLUDES = PROJECT / "povray_includes"
SCHEMA = "scene.schema.json"
#: In the build folder: how fast this machine is, and how far off what it makes quickly.
CALIBRATION = "calibration.json"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}")
RESERVED = {"inputs", "basis", "pov", "runs", "closure", "export", "trials", "working", "study", "compare", "match"}


def checked_name(name: str, what: str) -> str:
    """A scene's or fog's name that cannot leave its folder."""
    if not NAME.fullmatch(name) or ".." in name or name in RESERVED:
        raise InputError(f"{what} name '{name}'", place="command line",
                         remedy="use letters, digits, '_', '-' and '.', beginning with a letter or digit,"
                                f" without slashes, and none of {', '.join(sorted(RESERVED))}")
    return name


@dataclass(frozen=True)
class Build:
    """Names of all files of one scene and one fog. `fog` is None for the scene's default fog.

    reduced: images are those of the working size, which only large photographs have.
    """

    scene: str
    fog: str | None = None
    scenes: Path = Path("scenes")
    builds: Path = Path("build")
    reduced: bool = False

    def __post_init__(self):
        checked_name(self.scene, "scene")
        if self.fog is not None:
            checked_name(self.fog, "fog")

    @property
    def source(self) -> Path:
        return self.scenes / self.scene

    @property
    def scene_file(self) -> Path:
        return self.source / "scene.yaml"

    @property
    def shared(self) -> Path:
        return self.builds / self.scene

    @property
    def out(self) -> Path:
        return self.shared / self.fog if self.fog else self.shared

    @property
    def full(self) -> Build:
        """The same, but images are those of the photograph's size."""
        return replace(self, reduced=False)

    @property
    def images(self) -> Path:
        """Images of the photograph."""
        return self.shared / "working" if self.reduced else self.shared

    @property
    def fog_images(self) -> Path:
        """Maps of one fog."""
        return self.out / "working" if self.reduced else self.out

    def input(self, part: str) -> Path:
        """One resolved part of the scene file; a part that did not change keeps its time stamp."""
        folder = self.out if part in ("fog", "fog_files", "render", "composite", "gains") else self.shared
        return folder / "inputs" / f"{part}.json"

    @property
    def lines(self) -> Path:
        """Line of each key in the scene file, for messages."""
        return self.out / "inputs" / "lines.json"

    # of the photograph
    @property
    def photograph(self) -> Path:
        return self.images / "photograph.exr"

    @property
    def clipped(self) -> Path:
        return self.images / "clipped.exr"

    @property
    def photograph_facts(self) -> Path:
        return self.shared / "photograph.json"

    @property
    def camera(self) -> Path:
        return self.shared / "camera.json"

    @property
    def geometry(self) -> Path:
        return self.shared / "geometry.json"

    @property
    def depth(self) -> Path:
        return self.images / "depth.exr"

    @property
    def surfaces(self) -> Path:
        return self.images / "surfaces.exr"

    @property
    def edges(self) -> Path:
        return self.images / "edges.exr"

    def edge_colours(self, side: str) -> Path:
        """Radiance of the front layer or behind it, at pixels that show two things at once."""
        return self.images / f"edges_{side}.exr"

    @property
    def sun_direction(self) -> Path:
        return self.shared / "sun_direction.json"

    @property
    def illumination(self) -> Path:
        return self.shared / "illumination.json"

    @property
    def albedo(self) -> Path:
        return self.images / "albedo.exr"

    @property
    def overlay(self) -> Path:
        return self.shared / "overlay.png"

    @property
    def carried_truth(self) -> Path:
        """What the camera of a scene that we made would have seen in the fog, rendered from its model."""
        return self.source / "truth" / f"{self.fog or 'default'}.exr"

    @property
    def ladder(self) -> Path:
        """The photograph and all its fogs, side by side."""
        return self.shared / "ladder.png"

    @property
    def basis(self) -> Path:
        """Clear renders of each light alone."""
        return self.shared / "basis"

    @property
    def albedos_begun(self) -> Path:
        """Albedos by face from which the estimate of the light begins; only where a preview knows them from before."""
        return self.shared / "inputs" / "albedos_begun.json"

    @property
    def surroundings(self) -> Path:
        """What the fog before the photograph sees round it."""
        return self.basis / "surroundings.exr"

    @property
    def surrounding_hits(self) -> Path:
        return self.basis / "surroundings_hits.exr"

    @property
    def room(self) -> Path:
        """What points all over a room, and patches of its surfaces, see."""
        return self.basis / "room.exr"

    @property
    def room_hits(self) -> Path:
        return self.basis / "room_hits.exr"

    @property
    def room_places(self) -> Path:
        return self.basis / "room_places.exr"

    # of one fog

    @property
    def plan(self) -> Path:
        return self.out / "plan.json"

    @property
    def pov(self) -> Path:
        return self.out / "pov"

    @property
    def runs(self) -> Path:
        return self.out / "runs"

    @property
    def runs_done(self) -> Path:
        return self.out / "runs" / "done.json"

    @property
    def transmittance(self) -> Path:
        return self.fog_images / "transmittance.exr"

    def in_scattering(self, light: str | None = None) -> Path:
        return self.fog_images / (f"in_scattering_{light}.exr" if light else "in_scattering.exr")

    def behind(self, path: Path) -> Path:
        """The same map behind what is in front, of the working size, where a pixel shows two things at once."""
        return path.with_name(f"behind_{path.name}")

    @property
    def mean_density(self) -> Path:
        """Mean density of the fog along each ray, of the working size."""
        return self.out / "working" / "mean_density.exr"

    @property
    def maps(self) -> Path:
        """Written after all maps of a fog are complete."""
        return self.out / "maps.json"

    def foggy(self, suffix: str) -> Path:
        return self.out / f"foggy{suffix}"

    def export(self, language: str) -> Path:
        """The scene in another program's language."""
        return self.out / "export" / language

    @property
    def crosscheck(self) -> Path:
        """T and V against another renderer's; the picture beside it is of the same name."""
        return self.out / "crosscheck.json"

    @property
    def compare(self) -> Path:
        """The same photograph in fog by us and by others."""
        return self.out / "compare"

    @property
    def truth(self) -> Path:
        """The model of a photograph in this fog, where there is one and `make truth` was asked; facts are beside it."""
        return self.out / "truth.exr"

    @property
    def match(self) -> Path:
        """Fog found in another photograph: match.json and pictures."""
        return self.shared / "match"

    def trial_maps(self, name: str) -> Path:
        """Small maps of a fog that was tried, kept for the next match."""
        return self.shared / "trials" / "match" / name

    @property
    def manifest(self) -> Path:
        return self.out / "manifest.json"

    @property
    def report(self) -> Path:
        return self.out / "report.html"

    @property
    def ahead(self) -> Path:
        """Which make ran and which stages one process did for it beyond the first."""
        return self.out / ".ahead"

    @property
    def seconds(self) -> Path:
        """Seconds each stage took, one JSON file a stage."""
        return self.out / "inputs" / "seconds"


def inside(build: Build, name: str, stated_at: str | None = None) -> Path:
    """A file of the scene's folder; a name that leads out of it is refused, with `stated_at` [FILE:LINE]."""
    return inside_folder(build.source, name, stated_at or str(build.scene_file), "scene")


def inside_folder(folder: Path, name: str, stated_at: str, whose: str) -> Path:
    """A file of `folder`, which is that of the scene or whatever else names it."""
    path = folder / name
    try:
        if "\0" in name:
            raise ValueError
        path.resolve().relative_to(folder.resolve())
    except ValueError:
        raise InputError(f"'{name}' leads out of the {whose}'s folder", place=stated_at,
                         remedy=f"put the file into {folder}") from None
    # a pipe or a device would be waited for without end
    if path.exists() and not path.is_file() and not path.is_dir():
        raise InputError(f"'{name}' is no plain file", place=stated_at,
                         remedy="name a file that holds the data itself")
    return path
