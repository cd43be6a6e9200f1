"""Ground truth for `make compare`: the model of a scene that the project carries, in one of its fogs.

    python -m tests.validation.ground_truth [--carry]        scene, fog and folders as the pipeline's: FOG_SCENE, FOG_NAME, ...

writes truth.exr and truth.json beside the scene's foggy photograph, of the fog that it was resolved with. Only POV-Ray is run,
on the project's own models, whatever the scene's folder holds. In the environment: FOG_TRUTH_SIZE, pixels of the longer side.
With --carry it is also put into the scene's folder, as truth/FOG.exr, where `make compare` finds it.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from dataclasses import asdict
from pathlib import Path

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import PROJECT, Build
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, scene_place, write_json
from tests.validation import foggy_model, models
from tests.validation.foggy_model import Quality, in_fog
from tests.validation.models import MODELS

#: Pixels of the longer side, where nothing else is asked: some minutes a fog on one core.
SIZE = 128
ABOUT = "ground truth: the model itself in this fog, light of all orders (make truth)"
IN_THE_OPEN = ("ground truth: the model itself in this fog; sun and sky arrive as the photograph shows them and are scattered"
               " once (make truth)")


def main() -> int:
    try:
        build = Build(os.environ.get("FOG_SCENE", ""), os.environ.get("FOG_NAME") or None,
                      Path(os.environ.get("FOG_SCENES", "scenes")), Path(os.environ.get("FOG_BUILD", "build")))
        path = write(build, Quality(size=_size()))
        print(f"done: {path}")
        if "--carry" in sys.argv[1:]:
            print(f"done: {_carried(build, path)}")
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def write(build: Build, quality: Quality) -> Path:
    """Renders the truth unless it is there for the same fog, model and quality; its path."""
    if build.scene not in MODELS:
        raise InputError(f"the project carries no model of '{build.scene}'", place="make truth",
                         remedy=f"ask for one of {', '.join(MODELS)}")
    model, medium = MODELS[build.scene](), read_fog(build)
    if medium.is_clear():
        raise InputError("the fog is clear: the photograph is its own truth", place=str(build.scene_file), remedy="pick a denser fog")
    if medium.top() is not None and any(group.clear for group in model.groups):
        raise InputError("the truth of fog with a top in the open air is not known: it dims sun and sky on their way down",
                         place=scene_place(build, "fog"), remedy="leave out 'top_height', or pick another fog")
    facts = {"fog": read_json(build.input("fog")), "model": _digest(model.file.parent), "quality": asdict(quality)}
    path = build.truth.with_suffix(".json")
    if build.truth.exists() and path.exists() and facts.items() <= dict(read_json(path)).items():
        return build.truth
    start = time.monotonic()
    picture = in_fog(model, medium, quality)
    write_map(build.truth, picture, {**fog_metadata(build, medium), "fog:content": "ground truth, linear scene-referred Rec.709"})
    about = IN_THE_OPEN if all(group.clear for group in model.groups) else ABOUT
    write_json(path, {**facts, "about": about, "seconds": round(time.monotonic() - start, 1)})
    return build.truth


def _carried(build: Build, path: Path) -> Path:
    """The truth, in half floats, in the scene's folder."""
    sys.path.insert(0, str(PROJECT / "scenes"))
    import in_fog

    method = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))["about"].removeprefix("ground truth: ")
    return in_fog.write_truth(build.source, in_fog.fog(build.source, build.fog or "default"), read_map(path), method)


def _digest(folder: Path) -> str:
    """Of the model's files and of what renders it."""
    files = sorted(folder.glob("*.pov")) + sorted(folder.glob("*.inc")) + [Path(foggy_model.__file__), Path(models.__file__)]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def _size() -> int:
    text = os.environ.get("FOG_TRUTH_SIZE") or str(SIZE)
    if not text.isdecimal() or len(text) > 6 or not 8 <= int(text) <= 4096:
        raise InputError(f"FOG_TRUTH_SIZE={text[:40]}", place="environment", remedy="give a whole number from 8 to 4096")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
