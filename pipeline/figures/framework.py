"""Fig. 2: the way from a photograph to its fog, drawn from a scene's intermediate images."""

from __future__ import annotations

from pathlib import Path

from pipeline.figures import sheets
from pipeline.figures.pictures import Pictures
from pipeline.imaging.display import displayed, tone_factor
from pipeline.imaging.maps import read_map
from pipeline.paths import Build

#: Columns and rows of the drawing: left edge, lower edge, width, height in shares of the sheet.
BOX_WIDTH, BOX_HEIGHT = 0.15, 0.33
PLACES = {"photograph": (0.012, 0.50), "annotations": (0.012, 0.08), "geometry": (0.225, 0.50), "light": (0.225, 0.08),
          "transmittance": (0.438, 0.50), "in_scattering": (0.438, 0.08), "result": (0.838, 0.29)}
#: Where T and R meet, and where V is added.
TIMES, PLUS = 0.665, 0.75
ARROWS = [("photograph", "geometry"), ("annotations", "geometry"), ("annotations", "light"), ("photograph", "light"),
          ("geometry", "transmittance"), ("light", "transmittance"), ("geometry", "in_scattering"), ("light", "in_scattering")]
TITLES = {"photograph": "one photograph R", "annotations": "annotations", "geometry": "depth and boxes",
          "light": "light by light", "transmittance": "transmittance map T",
          "in_scattering": "volume map V", "result": "C = R T + V"}


def draw(scenes: Path, builds: Path, path: Path) -> None:
    one = Pictures(Build("bathroom", None, scenes, builds))
    plots = sheets.pyplot()
    figure = plots.figure(figsize=(sheets.WIDTH, 3.2))
    ground = figure.add_axes((0, 0, 1, 1))
    ground.set_axis_off()
    ground.set(xlim=(0, 1), ylim=(0, 1))
    basis = read_map(min(one.build.basis.glob("irradiance_*.exr")))
    images = {"photograph": one.photograph(), "annotations": one.annotated(), "geometry": one.depth(),
              "light": displayed(basis, tone_factor(basis)), "transmittance": one.transmittance(),
              "in_scattering": one.in_scattering(), "result": one.foggy()}
    for name, image in images.items():
        left, low = PLACES[name]
        axes = figure.add_axes((left, low, BOX_WIDTH, BOX_HEIGHT))
        axes.set_axis_off()
        axes.imshow(image)
        ground.text(left + BOX_WIDTH / 2, low - 0.015, TITLES[name], ha="center", va="top")
    for name, text in (("photograph", "input"), ("geometry", "estimation"), ("transmittance", "POV-Ray, closed forms"),
                       ("result", "composite")):
        ground.text(PLACES[name][0] + BOX_WIDTH / 2, 0.965, text, ha="center", va="center", weight="bold")
    style = {"arrowstyle": "-|>", "color": "0.35", "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0}

    def side(name: str, right: bool) -> tuple[float, float]:
        left, low = PLACES[name]
        return left + (BOX_WIDTH + 0.006 if right else -0.006), low + BOX_HEIGHT / 2

    for start, end in ARROWS:
        ground.annotate("", side(end, False), side(start, True), arrowprops=style)
    middle = PLACES["result"][1] + BOX_HEIGHT / 2
    for x, sign in ((TIMES, "×"), (PLUS, "+")):
        ground.text(x, middle, sign, ha="center", va="center", size=13, bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": "0.35"})
    ground.annotate("", (TIMES - 0.012, middle + 0.06), side("transmittance", True), arrowprops=style)
    ground.annotate("", (PLUS - 0.012, middle - 0.06), side("in_scattering", True), arrowprops=style)
    ground.annotate("", (PLUS - 0.022, middle), (TIMES + 0.022, middle), arrowprops=style)
    ground.annotate("", side("result", False), (PLUS + 0.022, middle), arrowprops=style)
    # the photograph itself, above all that is made from it
    left, low = PLACES["photograph"]
    above = low + BOX_HEIGHT + 0.055
    ground.plot([left + BOX_WIDTH / 2] * 2 + [TIMES], [low + BOX_HEIGHT + 0.01, above, above], color="0.35", linewidth=1.1)
    ground.annotate("", (TIMES, middle + 0.07), (TIMES, above), arrowprops=style)
    sheets.save(figure, path)
