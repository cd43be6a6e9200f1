"""Fig. 15 of Zhao et al. 2013: who picked what, of each group of stimuli; with intervals and the tests against chance.

Blue and orange are told apart by the colour-blind (Okabe and Ito 2008) and by their grey, and the orange is hatched.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline.imaging.atomic import replacing
from pipeline.study.description import TRUTH
from pipeline.study.statistics import CONFIDENCE, Tally

BLUE, ORANGE, GREY = "#0072B2", "#E69F00", "#D9D9D9"
SIMULATED = "SIMULATED: no person was asked"
NOBODY = "no answers have been collected"


def draw(tallies: Sequence[Tally], whole: Tally, participants: int, title: str, paths: Sequence[Path], *,
         simulated: bool = False, left_out: int = 0) -> None:
    """Writes the figure as each of `paths`, .png or .svg. Raises ImportError without matplotlib."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    style = {"font.size": 9, "svg.hashsalt": "study", "svg.fonttype": "none", "hatch.linewidth": 0.7, "axes.spines.top": False,
             "axes.spines.right": False, "text.parse_math": False}
    with matplotlib.rc_context(style):
        rows = range(len(tallies))
        figure, (counts, shares) = pyplot.subplots(
            1, 2, sharey=True, figsize=(8.6, 1.9 + 0.52 * len(tallies)), layout="constrained", width_ratios=[1.05, 1])
        _counts(counts, tallies)
        _shares(shares, tallies)
        counts.set_yticks(list(rows), [_label(number, one) for number, one in enumerate(tallies, 1)])
        counts.set_ylim(len(tallies) - 0.4, -0.6)
        if not participants:
            for axes in (counts, shares):
                axes.text(0.5, 0.5, NOBODY, transform=axes.transAxes, ha="center", va="center", color="0.3",
                          bbox={"facecolor": "white", "edgecolor": "0.6", "pad": 6})
        if simulated:
            figure.text(0.5, 0.5, "SIMULATED", fontsize=54, color="0.5", alpha=0.22, rotation=18, ha="center", va="center",
                        fontweight="bold", zorder=10)
        figure.suptitle(f"{title}\n{_about(whole, participants, simulated, left_out)}", fontsize=10)
        for path in paths:
            with replacing(path) as name:
                figure.savefig(name, dpi=160, format=path.suffix[1:],
                               metadata={"Software": None} if path.suffix == ".png" else {"Date": None, "Creator": None})
        pyplot.close(figure)


def _counts(axes, tallies: Sequence[Tally]) -> None:
    """How many picked the true one, how many the synthetic one, and how many were too late."""
    left = [0] * len(tallies)
    parts = [("picked the real or true one", "picked_true", {"color": BLUE}, "white"),
             ("picked the synthetic one", "picked_synthetic", {"facecolor": ORANGE, "edgecolor": "#6b4a00", "hatch": "///"}, "black"),
             ("no answer in time", "timed_out", {"facecolor": GREY, "edgecolor": "0.4", "hatch": "..."}, "black")]
    most = max([one.shown for one in tallies] + [1])
    for label, key, look, ink in parts:
        values = [getattr(one, key) for one in tallies]
        axes.barh(range(len(tallies)), values, left=left, height=0.62, linewidth=0.6, label=label, **look)
        for row, (start, value) in enumerate(zip(left, values)):
            # a number that has no room in its bar would cover another
            if value >= 0.045 * most:
                axes.text(start + value / 2, row, str(value), ha="center", va="center", fontsize=8, color=ink,
                          bbox=None if key == "picked_true" else {"facecolor": look["facecolor"], "edgecolor": "none", "pad": 0.8})
        left = [start + value for start, value in zip(left, values)]
    axes.set_xlabel("participants")
    axes.set_xlim(0, most)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=1, frameon=False, fontsize=8, borderaxespad=0.1,
                labelspacing=0.25)


def _shares(axes, tallies: Sequence[Tally]) -> None:
    """Share that picked the true one, with its interval; nobody can tell where it holds one half."""
    axes.axvline(50, color="0.35", linewidth=0.9, linestyle=(0, (4, 3)))
    for row, one in enumerate(tallies):
        if one.answered:
            axes.plot([100 * one.low, 100 * one.high], [row, row], color="black", linewidth=1.3, solid_capstyle="butt")
            axes.plot([100 * one.share], [row], "o" if one.p_holm >= 1 - CONFIDENCE else "D", color=BLUE, markersize=6,
                      markeredgecolor="black", markeredgewidth=0.7)
        told = f"{100 * one.share:.0f} %   {_p(one.p_holm)}" if one.answered else "–"
        axes.text(1.03, row, told, transform=axes.get_yaxis_transform(), va="center", fontsize=8)
    axes.text(1.03, 1.0, "share   p (Holm)", transform=axes.transAxes, va="bottom", fontsize=8, color="0.3")
    axes.text(50, 1.0, "chance", transform=axes.get_xaxis_transform(), ha="center", va="bottom", fontsize=8, color="0.3")
    axes.set_xlim(0, 100)
    axes.set_xticks([0, 25, 50, 75, 100])
    axes.set_xlabel(f"picked the real or true one [% of answers], {100 * CONFIDENCE:g} % interval")
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x", linewidth=0.3)


def _label(number: int, one: Tally) -> str:
    return f"g{number}  {one.scene}\n{one.density}" + (", rendered truth" if one.true_is == TRUTH else "")


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}" if value < 0.1 else f"p = {value:.2f}"


def _about(whole: Tally, participants: int, simulated: bool, left_out: int) -> str:
    if not participants:
        return NOBODY
    people = "1 participant" if participants == 1 else f"{participants} participants"
    said = [SIMULATED, f"{people} who guess"] if simulated else [people]
    if whole.answered:
        said.append(f"together {100 * whole.share:.0f} % [{100 * whole.low:.0f}, {100 * whole.high:.0f}], {_p(whole.p)}")
    if left_out:
        said.append(f"{left_out} files left out")
    return "; ".join(said)
