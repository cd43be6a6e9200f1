"""Pictures beside one another, and curves: as files that are the same at every drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing

#: Width [inch] of a sheet, and its pixels an inch: a printed page's.
WIDTH, DPI = 7.2, 200
#: Colours that the colour-blind tell apart (Okabe and Ito 2008), and marks for those who see none.
COLOURS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKS = "osD^vPX"


@dataclass(frozen=True)
class Panel:
    """image: (H, W, 3) uint8 RGB, or None, for which `title` says why."""

    title: str
    image: np.ndarray | None


def pyplot():
    """matplotlib without a display, its files without dates. Raises InputError where it is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise InputError("matplotlib is not installed", place="figures", remedy="run make setup-figures") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot as plots

    plots.rcParams.update({"font.size": 8, "axes.titlesize": 8, "figure.dpi": DPI})
    return plots


def save(figure, path: Path) -> None:
    """As PNG; whole or not at all."""
    with replacing(path) as name:
        figure.savefig(name, dpi=DPI, format="png", metadata={"Software": None})
    pyplot().close(figure)


def grid(path: Path, rows: Sequence[Sequence[Panel]]) -> None:
    """Panels (a), (b), ... in rows, each row as wide as the sheet, and all of its pictures of one height."""
    plots = pyplot()
    known = next((one.image.shape for row in rows for one in row if one.image is not None), (3, 4, 3))
    shapes = [[one.image.shape if one.image is not None else known for one in row] for row in rows]
    heights = [WIDTH / sum(w / h for h, w, _ in row) for row in shapes]
    figure = plots.figure(figsize=(WIDTH, sum(heights) + 0.24 * len(rows)), layout=None)
    total, top, letter = figure.get_figheight(), 0.0, ord("a")
    for row, sizes, height in zip(rows, shapes, heights):
        left = 0.0
        for one, (h, w, _) in zip(row, sizes):
            width = height * w / h
            axes = figure.add_axes((left / WIDTH + 0.003, 1 - (top + height) / total, width / WIDTH - 0.006, height / total))
            axes.set_axis_off()
            if one.image is None:
                axes.text(0.5, 0.5, one.title, ha="center", va="center", wrap=True, transform=axes.transAxes)
            else:
                axes.imshow(one.image, interpolation="lanczos" if w > 200 else "nearest", aspect="auto")
                text = f"({chr(letter)}) {one.title}"
                # a letter is about half as wide as high
                size = min(8.0, 72 * width / (0.52 * len(text)))
                figure.text((left + width / 2) / WIDTH, 1 - (top + height + 0.12) / total, text, ha="center", va="center", size=size)
                letter += 1
            left += width
        top += height + 0.24
    save(figure, path)


def missing(path: Path, why: str) -> None:
    """A sheet that says why there is no figure."""
    figure = pyplot().figure(figsize=(WIDTH, 1.2))
    figure.text(0.5, 0.5, why, ha="center", va="center", wrap=True, style="italic")
    save(figure, path)


def curves(path: Path, panels: Sequence[tuple[str, Sequence[float], dict[str, Sequence[float]]]], ylabel: str) -> None:
    """Panels (x label, x, values by name) side by side, on a logarithmic scale, with one legend."""
    plots = pyplot()
    figure, all_axes = plots.subplots(1, len(panels), figsize=(WIDTH, 3.2), layout="constrained", sharey=True, squeeze=False)
    for letter, (axes, (label, x, values)) in enumerate(zip(all_axes[0], panels)):
        for k, (name, y) in enumerate(values.items()):
            axes.plot(x, y, MARKS[k % len(MARKS)] + "-", color=COLOURS[k % len(COLOURS)], label=name, markersize=4, linewidth=1)
        axes.set(yscale="log", xlabel=label, title=f"({chr(ord('a') + letter)})")
        axes.grid(True, which="both", linewidth=0.3)
    all_axes[0][0].set_ylabel(ylabel)
    names = dict(zip(*reversed(all_axes[0][0].get_legend_handles_labels())))
    figure.legend(names.values(), names.keys(), loc="outside lower center", ncols=4, frameon=False)
    save(figure, path)
