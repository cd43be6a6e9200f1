"""Painting regions: strokes of a brush add to a region's outline, or are erased from it.

A region stays an outline with holes, as it is drawn point by point and as the scene file holds it: a stroke is the outline of what
a round brush covers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import shapely

from pipeline.annotate.page.drawing import Drawing
from pipeline.annotate.page.kinds import KINDS
from pipeline.annotate.page.things import at, listed, pixels
from pipeline.errors import InputError

MODES = ("off", "add", "erase")
#: Points of one stroke, and of an outline (`depth_section.Outline`) and holes of a region, at most.
MOST_STROKE, MOST_POINTS, MOST_HOLES = 1500, 2000, 200
#: By so much of the brush's radius an outline may leave out what a stroke covers; not less than so many pixels.
ROUGH, FINEST = 0.04, 0.2
#: Pieces and holes smaller than this share of the brush's own area are crumbs of a hand that trembles.
CRUMB = 0.15
#: Corners of a quarter of the brush's circle.
QUARTER = 6

Points = list[list[float]]


@dataclass(frozen=True)
class Area:
    """A region's outline and the holes in it, in pixels of the photograph."""

    outline: Points
    holes: list[Points]


def painted(before: Area | None, stroke: list[tuple[float, float]], radius: float, erase: bool, size: tuple[int, int]) -> Area:
    """A region after a stroke of a brush of this radius [pixel] along points, within a photograph of this size.

    Raises InputError where that is no single piece.
    """
    line = shapely.LineString(stroke) if len(set(stroke)) > 1 else shapely.Point(stroke[0])
    # only what is new is made coarser
    brush = line.buffer(radius, quad_segs=QUARTER).simplify(max(FINEST, ROUGH * radius)).intersection(shapely.box(0, 0, *size))
    if before is None:
        if erase:
            raise InputError("there is nothing to erase yet", remedy="paint first, or choose a region")
        found = brush
    else:
        # what a hand drew may cross itself
        there = shapely.make_valid(shapely.Polygon(before.outline, before.holes))
        found = there.difference(brush) if erase else there.union(brush)
    crumb = CRUMB * math.pi * radius**2
    pieces = sorted((one for one in getattr(found, "geoms", [found]) if one.geom_type == "Polygon" and one.area > 0), key=lambda one: -one.area)
    if not pieces:
        raise InputError("nothing of it would be left" if erase else "the stroke lies outside the photograph",
                         remedy="remove the region instead" if erase else "paint on the photograph")
    if len(pieces) > 1 and pieces[1].area > crumb:
        raise InputError("a region is one piece, and this would make two", remedy="leave a bridge, or cut the other part out as a hole"
                         if erase else "paint on from where it is, or add another region")
    area, tolerance = _area(pieces[0], crumb), FINEST
    while max(map(len, [area.outline, *area.holes])) > MOST_POINTS:
        area, tolerance = _area(pieces[0].simplify(tolerance), crumb), 1.5 * tolerance
    return area


def _area(polygon: shapely.Polygon, crumb: float) -> Area:
    holes = sorted((one for one in map(shapely.Polygon, polygon.interiors) if one.area > crumb), key=lambda one: -one.area)
    return Area(_points(polygon.exterior), [_points(one.exterior) for one in holes[:MOST_HOLES]])


def _points(ring) -> Points:
    return [[round(x, 1) + 0.0, round(y, 1) + 0.0] for x, y in list(ring.coords)[:-1]]  # + 0.0: no -0.0


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
        if command.get("value") in MODES:
            self.brush = command["value"] if self.brush != command["value"] else "off"
            self.draft = []

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
