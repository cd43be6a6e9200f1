"""A case: which scene, which mutations. Told by seed and number alone, so that each can be run again."""

from __future__ import annotations

import copy
import json
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random

from tests.fuzzing import files, text, tree
from tests.fuzzing.bases import Base, bases

KINDS = {"text": 30, "tree": 40, "photograph": 10, "labels": 8, "depth": 6, "grid": 6}
#: Nowhere in the results may this turn up, which lies outside the scene's folder.
SECRET = "7d1c-secret-of-another-folder"
SCENE = "hostile"
#: Cases rendered by POV-Ray as well, one in so many.
RENDERED = 200


@dataclass(frozen=True)
class Case:
    seed: int
    number: int
    kind: str
    base: str
    #: Mutations, each by its own name and number, so that leaving one out leaves the others as they are.
    steps: tuple[tuple[str, int], ...]
    fog: str | None
    rendered: bool

    def without(self, step: int) -> "Case":
        return replace(self, steps=self.steps[:step] + self.steps[step + 1:])

    @property
    def told(self) -> str:
        return f"{self.kind} of {self.base}, {', '.join(name for name, _ in self.steps)}"


def case_of(seed: int, number: int, kinds: list[str]) -> Case:
    rng = Random(f"{seed}:{number}")
    kind = rng.choices(kinds, [KINDS[k] for k in kinds])[0]
    base = rng.choice(bases())
    known = {"text": (text.MUTATORS, text.WEIGHTS), "tree": (tree.MUTATORS, tree.WEIGHTS)}.get(kind)
    names = rng.choices(list(known[0]), known[1], k=rng.choice([1, 1, 2, 3])) if known else [kind]
    if kind == "text" and rng.random() < 0.03:
        names.append("bytes_of")
    fog = rng.choice(list(base.values["fogs"])) if rng.random() < 0.4 else None
    return Case(seed, number, kind, base.name, tuple((name, rng.randrange(2**32)) for name in names), fog,
                number % RENDERED == 0)


def write(case: Case, root: Path) -> dict[str, str]:
    """The case's scene in root/scenes, with things beside it that no scene may reach; overrides it asks for."""
    base = next(b for b in bases() if b.name == case.base)
    folder = root / "scenes" / SCENE
    folder.mkdir(parents=True)
    for place in ("outside", "elsewhere"):
        (root / place).mkdir()
    (root / "outside" / "secret.png").write_text(SECRET)
    (root / "outside" / "secret.inc").write_text(f"// {SECRET}\n")
    for name, data in base.files.items():
        (folder / name).write_bytes(data)
    (folder / "link.png").symlink_to(root / "outside" / "secret.png")
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    overrides: dict[str, str] = {}
    content = _mutated(case, base)
    if case.kind not in ("text", "tree"):
        overrides = files.write(Random(case.steps[0][1]), case.kind, base, folder) if case.steps else {}
    (folder / "scene.yaml").write_bytes(content)
    return overrides


def _mutated(case: Case, base: Base) -> bytes:
    if case.kind == "tree":
        values = copy.deepcopy(base.values)
        for name, number in case.steps:
            if values:
                tree.MUTATORS[name](Random(number), values)
        # JSON is YAML but for the numbers that are none, and written a hundred times as fast
        said = json.dumps(values, ensure_ascii=False)
        return re.sub(r"(-?)\b(NaN|Infinity)\b", lambda m: f"{m[1]}.{m[2][:3].lower()}", said).encode("utf-8", "replace")
    said: str = base.text
    for name, number in case.steps if case.kind == "text" else ():
        if name == "bytes_of":
            return text.bytes_of(Random(number), said)
        said = text.MUTATORS[name](Random(number), said)
    return said.encode("utf-8", "replace")


def keep(case: Case, found: dict, root: Path) -> Path:
    """Writes a failing case down; the folder."""
    folder = root / f"{case.seed}-{case.number}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.json").write_text(json.dumps({
        "seed": case.seed, "case": case.number, "mutated": case.told, "steps": case.steps, "fog": case.fog,
        "found": found}, indent=1) + "\n")
    return folder
