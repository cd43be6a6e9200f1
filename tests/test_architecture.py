"""Imports go one way, plugins and templates belong together, files stay small. Sources are read, not run."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]
MODULES = {".".join(path.relative_to(PROJECT).with_suffix("").parts).removesuffix(".__init__"): path
           for path in sorted((PROJECT / "pipeline").rglob("*.py"))}
#: A file longer than this serves more than one purpose.
MOST_LINES = 450

#: What computes, and what else of the project it may know. None of these reads or writes anything.
PURE = {"pipeline.physics": {"pipeline.physics", "pipeline.geometry", "pipeline.errors", "pipeline.side_by_side"},
        "pipeline.geometry": {"pipeline.geometry", "pipeline.errors", "pipeline.side_by_side"},
        "pipeline.estimation": {"pipeline.estimation", "pipeline.physics", "pipeline.geometry",
                                "pipeline.errors", "pipeline.side_by_side"}}
#: Libraries that compute; json turns text into values, and cv2 is watched for its file functions below.
LIBRARIES = {"__future__", "astral", "collections", "cv2", "dataclasses", "datetime", "functools",
             "itertools", "json", "math", "nlopt", "numpy", "re", "scipy", "shapely", "tinyvdb", "typing", "zoneinfo"}
#: Functions by which those libraries, or the language itself, read and write files.
FILE_FUNCTIONS = {"open", "print", "input", "load", "loadtxt", "save", "savez", "savetxt", "fromfile",
                  "tofile", "memmap", "imread", "imwrite", "read_text", "read_bytes",
                  "write_text", "write_bytes"}


def imports(name: str) -> Iterator[str]:
    """Modules that module `name` imports anywhere, also inside functions; of the project's, by full name."""
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{name}: write imports in full, so that their direction can be seen"
            # `from package import module` is an import of the module, `from module import name` of the module
            yield from ({f"{node.module}.{alias.name}" for alias in node.names} & set(MODULES)
                        or {node.module})


def package(name: str) -> str:
    """`pipeline.physics` for all modules in that folder, the module's own name for those beside it."""
    return ".".join(name.split(".")[:2])


def within(*packages: str) -> list[str]:
    return [name for name in MODULES if package(name) in packages]


@pytest.mark.parametrize("name", within(*PURE))
def test_physics_geometry_and_estimation_only_compute(name):
    for imported in imports(name):
        if imported.startswith("pipeline"):
            assert package(imported) in PURE[package(name)], f"{name} imports {imported}"
        else:
            assert imported.split(".")[0] in LIBRARIES, f"{name} imports {imported}"
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            assert called not in FILE_FUNCTIONS, f"{name}:{node.lineno} calls {called}"


def test_stages_meet_only_in_files():
    for name in MODULES:
        if package(name) == "pipeline.stages":
            assert not [i for i in imports(name) if package(i) == "pipeline.stages"], name
    # the command line picks a stage by its name, and nothing else knows them
    assert not [name for name in MODULES for i in imports(name) if package(i) == "pipeline.stages"]


def test_plugins_know_neither_files_nor_renderer_nor_stages():
    allowed = {"pipeline.plugins", "pipeline.physics", "pipeline.geometry", "pipeline.errors"}
    for name in within("pipeline.plugins"):
        foreign = [i for i in imports(name) if i.startswith("pipeline") and package(i) not in allowed]
        assert not foreign, f"{name} imports {foreign}"


def test_only_the_entry_knows_the_command_line():
    assert [name for name in MODULES if "pipeline.cli" in imports(name)] == ["pipeline.__main__"]


def test_nothing_below_knows_the_annotator():
    assert {package(name) for name in MODULES for i in imports(name) if package(i) == "pipeline.annotate"} <= {
        "pipeline.annotate", "pipeline.cli"}


def test_rooms_of_annotate_know_what_lies_before_them():
    """The scene as it is written and its preview know nothing of other programs' files, and none of them of the page."""
    known = {"written": {"written"}, "preview": {"preview"}, "exchange": {"exchange", "written"},
             "page": {"page", "preview", "exchange", "written"}}
    for name in within("pipeline.annotate"):
        room = [*name.split("."), ""][2]
        for imported in imports(name) if room else ():
            if imported.startswith("pipeline.annotate."):
                assert imported.split(".")[2] in known[room], f"{name} imports {imported}"


def test_no_module_imports_itself_round_about():
    graph = {name: {i for i in imports(name) if i in MODULES and i != name} for name in MODULES}
    TopologicalSorter(graph).prepare()  # raises CycleError, naming the cycle


@pytest.mark.parametrize("kind", ["lights", "media", "phase_functions", "shapes"])
def test_every_plugin_has_a_template_of_its_name(kind):
    plugins = {path.stem for path in (PROJECT / "pipeline/plugins" / kind).glob("*.py")} - {"__init__"}
    templates = {path.stem for path in (PROJECT / "templates" / kind).glob("*.inc")}
    assert plugins and plugins <= templates, f"templates/{kind} lacks {plugins - templates}"


def test_files_stay_small():
    lines = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in MODULES.items()}
    assert not {name: count for name, count in lines.items() if count > MOST_LINES}
