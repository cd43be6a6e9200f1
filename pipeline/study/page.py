"""A user study as one HTML file that needs neither server nor network.

What the page holds does not say which of two pictures is the true one: all pictures lie in one shuffled list, a
stimulus names its two in random order, and which one is meant is the parity of the bits of a random number. That keeps an honest
person from stumbling over it; it is no secret from one who reads the script. No picture has a name or metadata.
"""

from __future__ import annotations

import base64
import hashlib
import json
import random
from typing import Any

import jinja2
from markupsafe import Markup

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.display import data_uri
from pipeline.paths import TEMPLATES
from pipeline.scene.artefacts import write_json
from pipeline.study.answers import ANSWERS, VERSION
from pipeline.study.description import Study
from pipeline.study.stimuli import Pictures

#: JPEG, with full colour resolution: about a bit a pixel, and no block shows.
QUALITY = 92
#: Bytes beyond which a page is slow to open on a telephone.
LARGEST = 60_000_000


def page(study: Study, shown: dict[str, Pictures]) -> tuple[str, dict[str, Any]]:
    """The page's text, and what is recorded of it beside: pure, the same for the same pictures."""
    uris = {one.name: [data_uri(picture, QUALITY) for picture in _three(shown[one.name])] for one in study.stimuli}
    every = list(dict.fromkeys(uri for three in uris.values() for uri in three))
    build = hashlib.sha256(json.dumps([study.digest, study.title, every]).encode()).hexdigest()[:16]
    luck = random.Random(build)
    luck.shuffle(every)
    data = {"format": ANSWERS, "version": VERSION, "digest": study.digest, "build": build, "title": study.title,
            "seconds": study.seconds, "pictures": every,
            "stimuli": [_trial(one, [every.index(uri) for uri in uris[one.name]], luck) for one in study.stimuli]}
    sizes = {one.name: shown[one.name].clear.shape[1::-1] for one in study.stimuli}
    record = {"format": "fog-study", "version": VERSION, "title": study.title, "digest": study.digest, "build": build,
              "seconds": study.seconds, "pictures": f"sRGB, JPEG of quality {QUALITY}, 4:4:4, without metadata; all alike",
              "stimuli": {one.name: {"scene": one.build.scene, "fog": one.fog, "density": one.density, "true_is": one.kind,
                                     "practice": one.practice, "size_pixel": sizes[one.name]} for one in study.stimuli}}
    return rendered(study, data), record


def write_page(study: Study, shown: dict[str, Pictures]) -> None:
    """study.html and study.json of the study's folder."""
    text, record = page(study, shown)
    if len(text) > LARGEST:
        raise InputError(f"{len(study.stimuli)} stimuli make a page of {len(text) / 1e6:.0f} MB", place=str(study.path),
                         remedy=f"show fewer, so that it stays below {LARGEST / 1e6:.0f} MB")
    study.folder.mkdir(parents=True, exist_ok=True)
    with replacing(study.page) as name:
        name.write_text(text, encoding="utf-8")
    write_json(study.record, record)


def rendered(study: Study, data: dict[str, Any]) -> str:
    """templates/study/study.html with its style, its script and the data; only these two run, by their digests."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES / "study"), autoescape=True,
                                     undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    script, style = ((TEMPLATES / "study" / name).read_text(encoding="utf-8") for name in ("study.js", "study.css"))
    return environment.get_template("study.html").render(
        title=study.title, script=Markup(script), style=Markup(style), data=data,
        script_digest=_digest(script), style_digest=_digest(style))


def _three(shown: Pictures) -> list:
    return [shown.clear, shown.synthetic, shown.other]


def _trial(stimulus, places: list[int], luck: random.Random) -> dict[str, Any]:
    """A stimulus as the page knows it; `places` are those of clear, synthetic and true."""
    true_one = luck.randrange(2)
    pair = [places[2], places[1]] if true_one == 0 else [places[1], places[2]]
    mark = luck.getrandbits(30)
    mark = mark << 1 | (mark.bit_count() + true_one) % 2  # its bits are odd in number where the second one is true
    return {"id": stimulus.name, "scene": stimulus.build.scene, "fog": stimulus.fog, "density": stimulus.density,
            "true_is": stimulus.kind, "practice": stimulus.practice, "clear": places[0], "pair": pair, "mark": mark}


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
