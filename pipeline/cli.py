"""Command line: one subcommand a stage, and what a person asks of the plugins and the scene format.

Make names the scene, the fog and the overrides in the environment (FOG_SCENE, FOG_NAME, FOG_OVERRIDES with
one KEY=VALUE a line), so that no value passes through a shell.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import json
import os
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pipeline.errors import InputError
from pipeline.ownership import at_work
from pipeline.paths import SCHEMA, Build

STAGES = {
    "resolve": "scene file and overrides -> inputs",
    "photograph": "photograph -> linear radiance",
    "camera": "annotated lines -> camera",
    "geometry": "annotated boxes and lights -> metres, depth",
    "sun_direction": "windows and patches -> sun direction",
    "illumination": "photograph -> light strengths",
    "plan": "what must be rendered, and why",
    "emit": "plan -> .pov files",
    "render": ".pov files -> images, by POV-Ray",
    "decompose": "images -> T and V",
    "composite": "photograph, T and V -> foggy photograph",
    "report": "overlay, manifest and report.html",
}
#: A fog's: each is made from what the one before it wrote, so that after one of them all that follow are to be done.
CHAIN = list(STAGES)[list(STAGES).index("plan"):]


def main(arguments: list[str] | None = None) -> int:
    """Runs one subcommand; 0, or 2 after one line about a person's mistake."""
    try:
        options = _parser().parse_args(arguments)
        return options.run(options) or 0
    except InputError as error:
        return _refused(error)
    except KeyboardInterrupt:
        print("interrupted; what is finished is kept", file=sys.stderr)
        return 130
    except OSError as error:
        if error.errno is None:
            raise
        return _refused(_of_the_machine(error))


def _refused(error: InputError) -> int:
    print(f"error: {error}", file=sys.stderr)
    return 2


def _of_the_machine(error: OSError) -> InputError:
    """A full disk, a folder that may not be written, and what else a program meets on a machine."""
    remedy = {errno.ENOSPC: "free some space and run again", errno.EDQUOT: "free some space and run again",
              errno.ENOTDIR: "remove the file that stands where a folder belongs",
              errno.EEXIST: "remove the file that stands where a folder belongs",
              }.get(error.errno, "check that it exists and may be read and written")
    return InputError(f"{error.strerror}", place=str(error.filename or "this machine"), remedy=remedy)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        raise InputError(message, place="command line", remedy=f"see {self.prog} --help")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="python -m pipeline", description="Physically based fog for one photograph.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, what in [*STAGES.items(), ("closure", "checks R*T + V against fog and surfaces in one render"),
                       ("export", "the scene in another program's language"),
                       ("crosscheck", "T and V against Mitsuba's"),
                       ("compare", "fog by us and by others, side by side"),
                       ("tradeoff", "time against error of knobs and plans"),
                       ("ladder", "the scene's named fogs side by side"),
                       ("match", "the fog of another photograph"), ("run", "all stages, in order")]:
        command = commands.add_parser(name, help=what, description=what)
        command.add_argument("--scene", default=os.environ.get("FOG_SCENE"), help="folder under scenes/")
        command.add_argument("--fog", default=os.environ.get("FOG_NAME") or None,
                             help="one of the scene's named fogs")
        _folders(command)
        command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
                             help="overrides a value of the scene, for example fog.visibility=3")
        command.set_defaults(run={"run": _run_all, "ladder": _ladder, "match": _match}.get(name, _run_stage))
        if name == "export":
            command.add_argument("--to", default=os.environ.get("FOG_TO", ""), help="an exporter, such as mitsuba")
        if name == "match":
            command.add_argument("--reference", default=os.environ.get("FOG_REFERENCE", ""),
                                 help="the photograph in fog, in the folder of the scene that it shows")
            command.add_argument("--reference-scene", default=os.environ.get("FOG_REFERENCE_SCENE") or None,
                                 help="the scene that it shows, where that is another one")
            command.add_argument("--to", default=os.environ.get("FOG_TO") or "matched", help="what the fog is to be called")
            command.add_argument("--fit", default=os.environ.get("FOG_FIT") or "visibility,albedo,gains",
                                 help="what is found, with commas between: visibility, albedo, gains, g")
        if name == "ladder":
            command.add_argument("--fogs", default=os.environ.get("FOG_LADDER", ""), help="names, with spaces between")
            command.add_argument("--names", action="store_true", help="only says which fogs it would show")
    plugins = commands.add_parser("plugins", help="lists all plugins with their parameters and units")
    plugins.set_defaults(run=_plugins)
    schema = commands.add_parser("schema", help="writes the scene file's JSON Schema")
    schema.add_argument("--output", type=Path, default=Path("scenes") / SCHEMA)
    schema.set_defaults(run=_schema)
    calibrate = commands.add_parser("calibrate", help="measures what the plan's model knows of time and error")
    _folders(calibrate)
    calibrate.add_argument("--cases", action="store_true", help="only says which scenes and fogs it measures")
    calibrate.set_defaults(run=_calibrate)
    figures = commands.add_parser("figures", help="draws the paper's figures from what was made")
    _folders(figures)
    figures.add_argument("--only", action="append", default=[], metavar="NAME", help="one of them, such as fig05")
    figures.add_argument("--book", action="store_true", help="writes the page and the PDF of those that are drawn")
    figures.set_defaults(run=_figures)
    for name, what, run in (("study", "a page that asks which of two foggy pictures is the real one", _study),
                            ("study-results", "what people answered, with intervals and tests", _study_results)):
        study = commands.add_parser(name, help=what, description=what)
        _folders(study)
        study.add_argument("--study", default=os.environ.get("FOG_STUDY", ""), help="its description; scenes/study.yaml")
        study.set_defaults(run=run)
        if name == "study":
            study.add_argument("--cases", action="store_true", help="only says which scenes and fogs it shows")
        else:
            study.add_argument("--answers", default=os.environ.get("FOG_ANSWERS", ""), help="folder of answer files")
            study.add_argument("--simulate", default=os.environ.get("FOG_SIMULATE", ""), help="so many who guess, instead of answers")
            study.add_argument("--seed", type=int, default=1, help="of those who guess")
    annotate = commands.add_parser("annotate", help="a page that annotates a photograph and shows its fog")
    annotate.add_argument("--scene", default=os.environ.get("FOG_SCENE"), help="folder under scenes/, a new one with --photo")
    annotate.add_argument("--photo", default=os.environ.get("FOG_PHOTO", ""), help="photograph of a new scene")
    annotate.add_argument("--port", default=os.environ.get("FOG_PORT", "0"), help="of the page; a free one when left out")
    annotate.add_argument("--no-browser", action="store_true", help="only says where the page is")
    _folders(annotate)
    annotate.set_defaults(run=_annotate, fog=None)
    annotations = commands.add_parser(
        "annotations", help="annotations of other programs into a scene, or a scene's into a file",
        description="Imports an fSpy project (.fspy) or its JSON, labelme's or COCO's JSON, or CVAT's XML for images 1.1 into"
                    " the scene file, or exports labelme's or fSpy's JSON. What a drawing stands for is said by its label,"
                    " such as light:lamp, window:door@room.left, region:trees, box:table or x for an edge that runs"
                    " left-right; see the README.")
    annotations.add_argument("--scene", default=os.environ.get("FOG_SCENE"), help="folder under scenes/")
    annotations.add_argument("--import", dest="to_import", nargs="?", const=os.environ.get("FOG_FILE", ""), metavar="FILE")
    annotations.add_argument("--export", dest="to_export", nargs="?", const=os.environ.get("FOG_FILE", ""), metavar="FILE")
    annotations.add_argument("--to", default=os.environ.get("FOG_TO", ""), help="labelme (usual) or fspy, for an export")
    annotations.add_argument("--replace", nargs="?", const="yes", default=os.environ.get("FOG_REPLACE", ""), metavar="yes",
                             help="what is there already may be replaced")
    annotations.add_argument("--image", default="", help="name of the picture, in a file of several")
    _folders(annotations)
    annotations.set_defaults(run=_annotations, fog=None)
    photos = commands.add_parser("photos",
                                 help="fetches the demo photographs that the repository does not carry")
    photos.add_argument("--scenes", type=Path, default=Path("scenes"))
    photos.add_argument("--scene", default=os.environ.get("FOG_SCENE") or None)
    photos.set_defaults(run=_photos)
    return parser


def _folders(command: argparse.ArgumentParser) -> None:
    command.add_argument("--scenes", type=Path, default=Path(os.environ.get("FOG_SCENES", "scenes")))
    command.add_argument("--build", type=Path, default=Path(os.environ.get("FOG_BUILD", "build")))


def _build(options) -> Build:
    if not options.scene:
        raise InputError("no scene is named", place="command line", remedy="say which: make scene=bathroom")
    return Build(options.scene, options.fog, options.scenes, options.build)


def _overrides(options) -> dict[str, str]:
    stated = [line for line in os.environ.get("FOG_OVERRIDES",
                                              "").splitlines() if line.strip()] + options.overrides
    result = {}
    for item in stated:
        key, equals, value = item.strip().partition("=")
        if not equals or not key:
            raise InputError(f"'{item}' is no KEY=VALUE", place="command line",
                             remedy="write fog.visibility=3")
        result[key] = value
    return result


def _run_stage(options) -> None:
    build, ahead = _build(options), os.environ.get("FOG_AHEAD", "")
    if options.command not in CHAIN or ahead not in CHAIN:
        _stage(build, options.command, options)
        return
    names = CHAIN[CHAIN.index(options.command):CHAIN.index(ahead) + 1]
    build.ahead.unlink(missing_ok=True)

    def done(name: str) -> None:
        with open(build.ahead, "a", encoding="utf-8") as noted:
            noted.write(f"{os.environ.get('FOG_RUN', '')} {name}\n")

    _chain(build, names or [options.command], done)


def _run_all(options) -> None:
    build, (first, *others) = _build(options), STAGES
    _stage(build, first, options)
    _chain(build, others)


def _ladder(options) -> None:
    build = _build(options)
    stage = importlib.import_module("pipeline.stages.ladder")
    names = stage.fogs_of(build, options.fogs.split())
    if options.names:
        print("\n".join(names))
        return
    with at_work(build):
        print(f"done: {stage.run(build, names)}")


def _match(options) -> None:
    from pipeline.scene.artefacts import working

    scene = replace(_build(options), fog=None)
    stage = importlib.import_module("pipeline.stages.match")
    view = replace(scene, scene=options.reference_scene or scene.scene, fog=options.fog)
    with at_work(view):
        stage.run(working(view), scene, options.reference, options.to, options.fit)


def _stage(build: Build, name: str, options) -> None:
    if name in ("resolve", "export"):
        module = importlib.import_module(f"pipeline.stages.{name}")
        if name == "resolve":
            module.run(build, _overrides(options))
            return
        from pipeline.scene.artefacts import for_stage

        with _at_work(build, name):
            module.run(for_stage(build, name), options.to)
        return
    _chain(build, [name])


def _chain(build: Build, names, done=lambda name: None) -> None:
    from pipeline import chain
    from pipeline.scene.artefacts import write_json

    def timed(name: str, seconds: float) -> None:
        write_json(build.seconds / f"{name}.json", round(seconds, 3))
        done(name)

    chain.run(build, names, done=timed, started=lambda name: _at_work(build, name))


@contextmanager
def _at_work(build: Build, name: str):
    print(f"{name}: {STAGES.get(name, 'checking')}", file=sys.stderr, flush=True)
    with at_work(build):
        yield


def _plugins(options) -> None:
    from pipeline.plugins.registry import KINDS, registry

    for kind in KINDS:
        print(kind)
        for name, cls in sorted(registry(kind).items()):
            print(f"  {name}: {(cls.__doc__ or '').strip().splitlines()[0]}")
            for key, field in cls.model_fields.items():
                if key == "type":
                    continue
                unit = (field.json_schema_extra or {}).get("unit", "")
                bounds = " ".join(str(m).replace("Ge(ge=", ">= ").replace("Gt(gt=", "> ").replace("Le(le=",
                                                                                                  "<= ")
                                  .replace("Lt(lt=", "< ").rstrip(")") for m in field.metadata
                                  if type(m).__name__ in ("Ge", "Gt", "Le", "Lt"))
                default = "required" if field.is_required() else f"default {field.default}"
                about = f"{default} {bounds}".rstrip() + f": {field.description or ''}"
                print(f"    {key} [{unit or '-'}] {about}")


def _schema(options) -> None:
    from pipeline.imaging.atomic import replacing
    from pipeline.scene.model import json_schema

    with replacing(options.output) as name:
        name.write_text(json.dumps(json_schema(), indent=1) + "\n", encoding="utf-8")


def _calibrate(options) -> None:
    from pipeline.planning import calibrate

    if options.cases:
        print("\n".join(f"scene={scene} fog={fog or ''}" for scene, fog in calibrate.CASES))
        return
    print(f"done: {calibrate.calibrate(options.scenes, options.build)}")


def _figures(options) -> None:
    from pipeline.figures import book, paper

    folder = options.build / "figures"
    for name in options.only or ([] if options.book else [one.name for one in paper.FIGURES]):
        print(f"drawn: {paper.draw(name, options.scenes, options.build, folder)}")
    if options.book:
        book.write(options.scenes, options.build, folder)
        print(f"done: {folder}/figures.html, {folder}/figures.pdf")


def _annotate(options) -> None:
    build = _build(options)
    if not options.port.isdecimal() or int(options.port[:9]) > 65535:
        raise InputError(f"port={options.port[:40]}", place="command line", remedy="give a whole number up to 65535, or leave it out")
    try:
        import bokeh  # noqa: F401
    except ModuleNotFoundError:
        raise InputError("Bokeh, which the page is made with, is not installed", place="this machine", remedy="run: make setup-annotate") from None
    from pipeline.annotate.written.new_scene import new_scene
    from pipeline.annotate.page.server import serve

    if options.photo:
        print(f"new: {new_scene(options.scenes, options.scene, Path(options.photo))}")
    serve(options.scenes, options.build, build.scene, int(options.port), browse=not options.no_browser)


def _described_study(options):
    from pipeline.study.description import DEFAULT, read_study

    return read_study(Path(options.study) if options.study else options.scenes / DEFAULT, options.scenes, options.build)


def _study(options) -> None:
    study = _described_study(options)
    if options.cases:
        builds = dict.fromkeys(one.build for one in study.stimuli)
        print("\n".join(f"scene={one.scene} fog={one.fog or ''} {one.foggy('.png')}" for one in builds))
        return
    from pipeline.study.page import write_page
    from pipeline.study.stimuli import pictures, write_sheet

    shown = {one.name: pictures(one) for one in study.stimuli}
    write_page(study, shown)
    print(f"done: {study.page}, {write_sheet(study, shown)}")


def _study_results(options) -> None:
    from pipeline.study.answers import Collected, collect
    from pipeline.study.results import write_results
    from pipeline.study.simulated import MOST, participants

    study = _described_study(options)
    if options.simulate and options.answers:
        raise InputError("both answers and simulate are there", place="command line", remedy="give one of them")
    if options.simulate and not (options.simulate.isdecimal() and 1 <= int(options.simulate[:9]) <= MOST):
        raise InputError(f"simulate={options.simulate[:40]}", place="command line", remedy=f"give a whole number from 1 to {MOST}")
    if options.simulate:
        found = Collected(participants(study, int(options.simulate), options.seed), [])
    else:
        found = collect(Path(options.answers), study) if options.answers else Collected([], [])
    for line in found.left_out:
        print(f"left out: {line}", file=sys.stderr)
    simulated = bool(options.simulate)
    drawn = write_results(study, found.participants, found.left_out, simulated=simulated)
    if not drawn:
        print("note: no picture without matplotlib; run make setup-figures", file=sys.stderr)
    told = f"{len(found.participants)} {'SIMULATED ' if simulated else ''}participants" if found.participants else "no answers were collected"
    print(f"done: {told}; {', '.join(str(study.results(s, simulated)) for s in ('.csv', '.json', *(('.png', '.svg') if drawn else ())))}")


def _annotations(options) -> None:
    from pipeline.annotate.exchange import command

    if (options.to_import is None) == (options.to_export is None):
        raise InputError("it is not said whether to import or to export", place="command line",
                         remedy="give one of --import FILE and --export FILE")
    if options.replace not in ("", "yes"):
        raise InputError(f"replace={options.replace}", place="command line", remedy="give replace=yes, or leave it out")
    if options.to_import is not None:
        command.imported(_build(options), options.to_import, replace=options.replace == "yes", image=options.image)
    else:
        command.exported(_build(options), options.to_export, options.to, replace=options.replace == "yes")


def _photos(options) -> int:
    from pipeline.imaging.fetch import fetch
    from pipeline.paths import checked_name

    names = [checked_name(options.scene, "scene")] if options.scene else sorted(
        p.parent.name for p in options.scenes.glob("*/photograph.yaml"))
    failed = 0
    for name in names:
        if not (options.scenes / name / "photograph.yaml").exists():
            continue
        try:
            print(f"{name}: {fetch(options.scenes / name)}")
        except InputError as error:  # one that is missing never breaks the rest
            print(f"error: {error}", file=sys.stderr)
            failed = 2
    return failed
