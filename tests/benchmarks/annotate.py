"""How long a person waits before the annotation page: from a slider, and from a change of geometry, to the picture in a browser.

    make bench-annotate [scene=bathroom]

The scene's photograph is enlarged to a megapixel, and to 24, of which the page shows a megapixel; median and worst are told, of what
the browser's own clock says between the event and the frame after the new picture was decoded.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

from tests.annotate_person import Person, Served
from tests.enlarged_scene import enlarged_scene
from tests.in_browser import chromium

#: Longer sides of the photographs [pixel]; a square one has a megapixel at 1000 and 24 at 4900.
SIDES = (1000, 4900)
SLIDES, CHANGES = 30, 10


def slider(person: Person, name: str, values) -> list[float]:
    """Milliseconds from each of a slider's values to its picture."""
    # waited for within the page: asking from outside again and again would take time of what is measured
    return [person.page.evaluate(f"""async () => {{ const one = document.querySelector('[data-slide="{name}"]');
        const count = window.annotate.shown.count, began = performance.now();
        one.value = {value};
        one.dispatchEvent(new Event("input", {{ bubbles: true }}));
        while (window.annotate.shown.count === count) await new Promise((done) => setTimeout(done, 4));
        return window.annotate.shown.at - began; }}""") for value in values]


def geometry(person: Person, corner: tuple[float, float], step: float, times: int) -> tuple[list[float], list[float]]:
    """Milliseconds from each release of a dragged corner to the first picture of the fog in the changed room, and to that in
    light that was estimated anew."""
    first, last = [], []
    for turn in range(times):
        other = (corner[0] + (step if turn % 2 == 0 else 0), corner[1])
        start = (corner[0] + (0 if turn % 2 == 0 else step), corner[1])
        person.until("() => !document.querySelector('.busy')")
        person.page.wait_for_timeout(600)  # until what came before has been saved and shown
        count = person.page.evaluate("window.annotate.shown.count")
        person.drag(start, other)
        began = person.page.evaluate("window.annotate.acted")
        person.until(f"() => window.annotate.shown.count > {count}")
        first.append(person.page.evaluate("window.annotate.shown.at") - began)
        person.until("() => !document.querySelector('.busy')")
        # the picture comes after the word that it is there
        person.page.wait_for_timeout(400)
        last.append(person.page.evaluate("window.annotate.shown.at") - began)
    return first, last


def told(what: str, milliseconds: list[float]) -> str:
    return f"{what}: median {statistics.median(milliseconds):.0f} ms, worst {max(milliseconds):.0f} ms of {len(milliseconds)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="bathroom")
    options = parser.parse_args()
    with chromium() as browser, tempfile.TemporaryDirectory() as folder:
        for side in SIDES:
            scenes = Path(folder) / str(side)
            enlarged_scene(options.scene, side, scenes / options.scene)
            served = Served(scenes, Path(folder) / "build", options.scene)
            person = Person(browser, served).come()
            person.until("() => window.annotate.shown.url.includes('/fog/') && !document.querySelector('.busy')")
            lights = [name for name in served.data()["lights"]]
            print(f"{options.scene}, photograph of {side} pixels on its longer side")
            print(told("  visibility", slider(person, "visibility", range(300, 300 + 10 * SLIDES, 10))))
            print(told("  albedo", slider(person, "albedo", range(990, 990 - 10 * SLIDES, -10))))
            print(told("  g", slider(person, "g", range(300, 300 + 10 * SLIDES, 10))))
            print(told(f"  gain of {lights[0]}", slider(person, f"gain {lights[0]}", range(300, 300 + 10 * SLIDES, 10))))
            boxes = [name for name, shape in served.data().get("shapes", {}).items() if shape["type"] == "cuboid"]
            if boxes:
                person.choose(boxes[0])
                name, corner = next(iter(served.data()["shapes"][boxes[0]]["corners"].items()))
                person.until("() => Bokeh.documents[0].get_model_by_name('handles').data.x.length > 0")
                first, last = geometry(person, tuple(corner), side / 40, CHANGES)
                print(told(f"  {boxes[0]}'s corner, roughly", first))
                print(told(f"  {boxes[0]}'s corner, in new light", last), flush=True)
            person.leave()
            served.end()


if __name__ == "__main__":
    main()
