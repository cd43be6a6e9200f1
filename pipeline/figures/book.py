"""All figures in order, on one HTML page and in one PDF, with captions, parameters, versions and seconds."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import jinja2

from pipeline.figures import sheets
from pipeline.figures.paper import FIGURES, Figure
from pipeline.imaging.atomic import replacing
from pipeline.paths import TEMPLATES, Build
from pipeline.scene.artefacts import read_json

#: A printed page [inch], its margin, and the size of what is written.
PAGE, MARGIN = (8.27, 11.69), 0.5


def facts(figure: Figure, scenes: Path, builds: Path) -> list[dict[str, Any]]:
    """Of each scene and fog that the figure shows: fog, seconds, versions, as its manifest has them."""
    found = []
    for scene, fog in figure.made_from:
        build = Build(scene, fog, scenes, builds)
        if build.manifest.exists():
            manifest = read_json(build.manifest)
            found.append({"scene": scene, "fog": fog or "default", "parameters": manifest["parameters"]["fog"],
                          "seconds": manifest["seconds"]["stages"], "versions": manifest["versions"]})
    return found


def write(scenes: Path, builds: Path, folder: Path) -> None:
    """figures.html and figures.pdf in `folder`, of the figures that are drawn there."""
    drawn = [(one, facts(one, scenes, builds)) for one in FIGURES if (folder / f"{one.name}.png").exists()]
    versions = next((fact["versions"] for _, known in drawn for fact in known), None)
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True,
                                     undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = environment.get_template("figures.html").render(
        figures=[{"name": one.name, "title": title(one), "caption": one.caption, "facts": known} for one, known in drawn],
        versions=versions, short=json.dumps)
    with replacing(folder / "figures.html") as name:
        name.write_text(text, encoding="utf-8")
    _pdf([one for one, _ in drawn], folder)


def title(figure: Figure) -> str:
    """Like "Fig. 5", "Table 1"."""
    number = figure.name.lstrip("figtable").lstrip("0")
    return f"{'Table' if figure.name.startswith('table') else 'Fig.'} {number}"


def _pdf(figures: Sequence[Figure], folder: Path) -> None:
    plots = sheets.pyplot()
    from matplotlib.backends.backend_pdf import PdfPages

    width, height = PAGE
    with replacing(folder / "figures.pdf") as name, PdfPages(name, metadata={"CreationDate": None, "Producer": None,
                                                                             "Creator": None}) as pages:
        sheet, below = None, 0.0
        for one in figures:
            picture = cv2.imread(str(folder / f"{one.name}.png"), cv2.IMREAD_COLOR)[..., ::-1]
            caption = textwrap.wrap(f"{title(one)}. {one.caption}", 108)
            shown = (width - 2 * MARGIN) * picture.shape[0] / picture.shape[1]
            needed = shown + 0.16 * len(caption) + 0.45
            if sheet is None or below - needed < MARGIN:
                if sheet is not None:
                    pages.savefig(sheet, dpi=sheets.DPI)
                    plots.close(sheet)
                sheet, below = plots.figure(figsize=PAGE), height - MARGIN
            axes = sheet.add_axes((MARGIN / width, (below - shown) / height, 1 - 2 * MARGIN / width, shown / height))
            axes.set_axis_off()
            axes.imshow(picture, interpolation="lanczos", aspect="auto")
            sheet.text(MARGIN / width, (below - shown - 0.08) / height, "\n".join(caption), va="top", size=8)
            below -= needed
        if sheet is not None:
            pages.savefig(sheet, dpi=sheets.DPI)
            plots.close(sheet)
