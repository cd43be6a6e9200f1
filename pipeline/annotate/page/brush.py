"""What strokes of a brush make of a region's outline.

A region stays an outline with holes, as it is drawn point by point and as the scene file holds it: a stroke is the outline of what
a round brush covers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import shapely

from pipeline.errors import InputError

#: Points of an outline (`depth_section.Outline`) and holes of a region, at most.
MOST_POINTS, MOST_HOLES = 2000, 200
#: By so much of the brush's radius an outline may leave out what a stroke covers; not less than so many pixels.
ROUGH, FINEST = 0.04, 0.2
#: Pieces and holes that a stroke leaves, smaller than this share of the brush's own area are crumbs of a hand that trembles.
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
    # small holes that the brush did not touch were meant
    holes = [one for one in map(shapely.Polygon, pieces[0].interiors) if one.area > crumb or not one.intersects(brush)]
    largest = sorted(holes, key=lambda one: -one.area)[:MOST_HOLES]
    whole, tolerance = shapely.Polygon(pieces[0].exterior, [one.exterior for one in largest]), FINEST
    area = _area(whole)
    while max(map(len, [area.outline, *area.holes])) > MOST_POINTS:
        area, tolerance = _area(whole.simplify(tolerance)), 1.5 * tolerance
    return area


def _area(polygon: shapely.Polygon) -> Area:
    return Area(_points(polygon.exterior), [_points(one) for one in polygon.interiors])


def _points(ring) -> Points:
    return [[round(x, 1) + 0.0, round(y, 1) + 0.0] for x, y in list(ring.coords)[:-1]]  # + 0.0: no -0.0
