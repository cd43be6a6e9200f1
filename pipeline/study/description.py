"""Which pictures a user study shows: a small file of the person's, scenes/study.yaml unless another is named.

A stimulus is three pictures: the clear photograph of a scene, the same in one of the scene's fogs as composed by the
pipeline, and what it is held against: a real foggy photograph, or the rendered truth of a scene that we made. A
rendered truth is never called real.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, StringConstraints, model_validator

from pipeline.errors import InputError
from pipeline.paths import Build, inside_folder
from pipeline.physics.visibility import visibility, visibility_class
from pipeline.plugins.base import FogName, Medium, Model, Name, mistake, parameter
from pipeline.scene.load import SceneText, load_scene, read_scene, validated

#: What a stimulus is held against.
PHOTOGRAPH, TRUTH = "photograph", "rendered truth"
FOLDER = "study"
DEFAULT = "study.yaml"
Label = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f-\x9f]+$", max_length=60)]
FileName = Annotated[str, StringConstraints(min_length=1, max_length=200)]


class StimulusDescription(Model):
    """One scene in one fog, and what it is held against."""

    scene: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]
    fog: FogName | None = parameter(None, description="one of the scene's named fogs; its own when left out")
    real: FileName | None = parameter(None, description="a real foggy photograph, from this file's folder on")
    truth: bool = parameter(False, description="instead of `real`: the rendered truth in scenes/SCENE/truth/FOG.exr")
    density: Label | None = parameter(None, description="how dense the fog is, in words; by its visibility when left out")

    @model_validator(mode="after")
    def _one_of_both(self):
        if (self.real is None) == (not self.truth):
            raise mistake("it is held against " + ("both 'real' and 'truth'" if self.truth else "nothing"),
                          "give one of 'real: PHOTOGRAPH' and 'truth: true'")
        return self


class StudyDescription(Model):
    """What scenes/study.yaml holds."""

    title: Label = "Which is the real fog?"
    seconds: float = parameter(15.0, "s", ge=1, le=600, description="to answer in; the paper's 15 when left out")
    practice: Annotated[dict[Name, StimulusDescription], Field(max_length=20)] = parameter(
        {}, description="shown first; their answers do not count")
    stimuli: Annotated[dict[Name, StimulusDescription], Field(min_length=1, max_length=60)]

    @model_validator(mode="after")
    def _one_name_each(self):
        for name in self.practice:
            if name in self.stimuli:
                raise mistake(f"'{name}' is a stimulus, too", "give what is practised a name of its own", at=("practice", name))
        return self


@dataclass(frozen=True)
class Stimulus:
    """A described stimulus with its files' names and its fog."""

    name: str
    build: Build
    medium: Medium
    kind: str
    other: Path
    density: str
    practice: bool
    place: str

    @property
    def fog(self) -> str:
        return self.build.fog or "default"


@dataclass(frozen=True)
class Study:
    """What a study shows. `digest` tells it from any other: scenes, fogs and seconds, but no pixels."""

    path: Path
    title: str
    seconds: float
    stimuli: tuple[Stimulus, ...]
    digest: str
    folder: Path

    @property
    def counted(self) -> tuple[Stimulus, ...]:
        return tuple(one for one in self.stimuli if not one.practice)

    @property
    def page(self) -> Path:
        return self.folder / "study.html"

    @property
    def record(self) -> Path:
        return self.folder / "study.json"

    @property
    def sheet(self) -> Path:
        """All stimuli in one picture, as Zhao et al. 2013, Fig. 13 and 14."""
        return self.folder / "stimuli.png"

    def results(self, suffix: str, simulated: bool = False) -> Path:
        return self.folder / f"{'simulated_' if simulated else ''}results{suffix}"


def read_study(path: Path, scenes: Path = Path("scenes"), builds: Path = Path("build")) -> Study:
    """The study of a file. Raises InputError naming file, line, value and what is allowed.

    Results of scenes/study.yaml go to build/study/, those of another FILE.yaml to build/study/FILE/.
    """
    text = read_scene(path, "study", "title, stimuli")
    described = validated(text, StudyDescription)
    stimuli = tuple(_stimulus(text, group, name, one, scenes, builds)
                    for group in ("practice", "stimuli") for name, one in getattr(described, group).items())
    folder = builds / FOLDER
    if path.resolve() != (scenes / DEFAULT).resolve():
        folder /= path.stem
    return Study(path, described.title, described.seconds, stimuli, _digest(described, stimuli), folder)


def _stimulus(text: SceneText, group: str, name: str, described: StimulusDescription, scenes: Path, builds: Path) -> Stimulus:
    place = text.place((group, name))
    try:
        build = Build(described.scene, described.fog, scenes, builds)
        medium = load_scene(build.scene_file, fog=described.fog).fog
    except InputError as error:
        raise InputError(f"{group}.{name}: {error.place}: {error.problem}", place=place, remedy=error.remedy) from None
    if described.real is not None:
        other = inside_folder(text.path.parent, described.real, text.place((group, name, "real")), "study")
        if not other.is_file():
            raise InputError(f"{group}.{name}: real = '{described.real}': no such file in {text.path.parent}",
                             place=text.place((group, name, "real")), remedy="correct its name, or put the photograph there")
    else:
        other = build.carried_truth
        if not other.is_file():
            raise InputError(f"{group}.{name}: no rendered truth {other}", place=text.place((group, name, "truth")),
                             remedy=f"run: make study-truth scene={build.scene} fogs={build.fog or 'default'}, for a scene whose"
                                    " model/ has a foggy.py, or give a photograph as 'real'")
    metres = visibility(sum(medium.coefficients()))
    density = described.density or f"{visibility_class(metres)}, {metres:.3g} m"
    return Stimulus(name, build, medium, TRUTH if described.truth else PHOTOGRAPH, other, density, group == "practice", place)


def _digest(described: StudyDescription, stimuli: tuple[Stimulus, ...]) -> str:
    """Of all that makes an answer mean the same; not of titles, labels and pixels, which may be made anew."""
    told: dict[str, Any] = {"seconds": described.seconds, "stimuli": [
        [one.name, one.practice, one.build.scene, one.fog, one.medium.model_dump(mode="json"), one.kind, one.other.name]
        for one in stimuli]}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]
