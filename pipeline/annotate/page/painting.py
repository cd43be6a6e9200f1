"""Painting regions: strokes of a brush add to a region's outline, or are erased from it."""

from __future__ import annotations

from pipeline.annotate.page.brush import Area, painted
from pipeline.annotate.page.drawing import Drawing
from pipeline.annotate.page.kinds import KINDS
from pipeline.annotate.page.things import at, listed, pixels
from pipeline.errors import InputError

MODES = ("off", "add", "erase")
#: Points of one stroke at most.
MOST_STROKE = 1500


class Painting(Drawing):
    """brush: whether strokes add or erase, or the mouse draws points and moves the view."""

    def __init__(self):
        super().__init__()
        self.brush = "off"

    @property
    def paintable(self) -> bool:
        """Whether there is a region to paint: one that is being added, or an outlined one that is chosen."""
        if self.adding is not None:
            return self.adding.form == "outline" and self.adding.name in ("ground", "upright", "sky_region")
        place = self.chosen or ()
        return place[:2] == ("depth", "regions") and len(place) > 2 and at(self.data, (*place[:3], "pixels")) is not None

    @property
    def painting(self) -> str:
        return self.brush if self.paintable and self.may_write else "off"

    def choose(self, place) -> None:
        if (place or ())[:3] != (self.chosen or ())[:3]:
            self.brush = "off"
        super().choose(place)

    def on_brush(self, command) -> None:
        wanted = command.get("value")
        if wanted in MODES and (self.paintable or wanted == "off"):
            self.brush, self.draft = wanted, []

    def on_stroke(self, command) -> None:
        """A stroke that ended: points of the photograph and the brush's radius there."""
        stroke, radius = pixels(command.get("points")), command.get("radius")
        if not stroke or len(stroke) > MOST_STROKE or not isinstance(radius, (int, float)) or not 0 < radius < 1e5:
            return
        if self.painting == "off":
            raise InputError("there is no region to paint", remedy="choose one that is outlined, or add one")
        place, before = (self.chosen or ())[:3], None
        if self.adding is None:
            outline, holes = pixels(at(self.data, (*place, "pixels"))), [pixels(one) for one in listed(self.data, *place, "holes")]
            if outline is None or None in holes:
                raise InputError("its outline holds what is no pixel", remedy="correct that in the scene file")
            before = Area(list(map(list, outline)), [list(map(list, one)) for one in holes])
        area = painted(before, list(stroke), float(radius), self.brush == "erase", (self.picture.width, self.picture.height))
        with self.desk.changing(self) as document:
            if self.adding is not None:
                drawn = KINDS[self.adding.name].make(self.data, area.outline, self.options)
                for where, value in drawn.values:
                    document.set(where, value)
                place, self.adding, self.draft = drawn.selected[:3], None, []
            document.set((*place, "pixels"), area.outline)
            if area.holes:
                document.set((*place, "holes"), area.holes)
            else:
                document.remove((*place, "holes"))
            self.chosen, self.point = (*place, "pixels"), None

    def on_cancel(self, command) -> None:
        if command.get("do") == "cancel" and self.painting != "off":
            self.brush = "off"
            return
        super().on_cancel(command)
