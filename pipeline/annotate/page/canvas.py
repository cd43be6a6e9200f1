"""The picture on the page: the photograph or its fog, what is drawn on it, and the points that a person moves.

A Bokeh plot whose coordinates are the full-size photograph's pixels, v downwards. Bokeh zooms, pans and drags points, with mouse
and touch; templates/annotate/page.js says when a drag moves a point and when it moves the view.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bokeh.core.properties import value
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.models import (
    ColumnDataSource, ImageURL, MultiLine, Patches, PanTool, Plot, PointDrawTool, Range1d, Scatter, Text, WheelZoomTool)

from pipeline.annotate.page.things import COLOURS, Thing

#: How close to something a click must be [CSS pixel]; a finger needs more.
REACH = 12
#: Width of the picture on a screen, until the browser tells it [CSS pixel].
USUAL = 900
#: Names to the right of this share of the picture's width stand on the left of what they name.
NEAR_BORDER = 0.85
CHOSEN, TROUBLE = "#ffffff", "#ff5c5c"


class Picture:
    """Bokeh's part of a page. `url(name)` is the address of a picture that the server holds."""

    def __init__(self, width: int, height: int):
        self.width, self.height = width, height
        self.source = ColumnDataSource({"url": []}, name="picture")
        self.outlines = ColumnDataSource({"xs": [], "ys": [], "colour": [], "wide": [], "fill": []}, name="outlines")
        self.seen = ColumnDataSource({"xs": [], "ys": [], "colour": [], "wide": [], "dark": [], "strong": []}, name="seen")
        self.spots = ColumnDataSource({"x": [], "y": [], "colour": []}, name="spots")
        self.labels = ColumnDataSource({"x": [], "y": [], "text": [], "colour": [], "align": [], "off": []}, name="labels")
        self.active = ColumnDataSource({"xs": [], "ys": []}, name="active")
        self.handles = ColumnDataSource({"x": [], "y": []}, name="handles")
        self.names = ColumnDataSource({"x": [], "y": [], "text": [], "align": [], "off": []}, name="names")
        margin = 0.02 * max(width, height)
        self.plot = Plot(name="plot", x_range=Range1d(-margin, width + margin), y_range=Range1d(height + margin, -margin),
                         sizing_mode="stretch_both", toolbar_location=None, min_border=0, outline_line_color=None,
                         background_fill_color="#232427", border_fill_color="#232427", lod_threshold=None)
        add = self.plot.add_glyph
        add(self.source, ImageURL(url="url", x=0, y=0, w=width, h=height, anchor="top_left"))
        add(self.outlines, Patches(xs="xs", ys="ys", fill_color="colour", fill_alpha="fill", line_color=None))
        add(self.seen, MultiLine(xs="xs", ys="ys", line_color="#101010", line_alpha=0.4, line_width="dark", line_join="round"))
        add(self.seen, MultiLine(xs="xs", ys="ys", line_color="colour", line_width="wide", line_alpha="strong", line_join="round"))
        add(self.outlines, MultiLine(xs="xs", ys="ys", line_color="#101010", line_alpha=0.5, line_width=3.2, line_join="round"))
        add(self.outlines, MultiLine(xs="xs", ys="ys", line_color="colour", line_width="wide", line_join="round"))
        add(self.spots, Scatter(x="x", y="y", marker="cross", size=13, line_color="colour", line_width=2))
        add(self.active, MultiLine(xs="xs", ys="ys", line_color="#101010", line_alpha=0.6, line_width=5, line_join="round"))
        add(self.active, MultiLine(xs="xs", ys="ys", line_color=CHOSEN, line_width=2, line_join="round"))
        plate = {"text_font": value("system-ui, 'DejaVu Sans', sans-serif"), "background_fill_color": "#1b1c1e", "background_fill_alpha": 0.7,
                 "padding": 3, "border_radius": 3}
        add(self.labels, Text(x="x", y="y", text="text", text_color="colour", text_font_size="12px", x_offset="off", y_offset=-6,
                              text_align="align", **plate))
        drawn = add(self.handles, Scatter(x="x", y="y", marker="circle", size=11, fill_color="#ffffff", fill_alpha=0.25,
                                          line_color=CHOSEN, line_width=2),
                    selection_glyph=Scatter(x="x", y="y", marker="circle", size=13, fill_color="#ffcf33", fill_alpha=0.9,
                                            line_color="#101010", line_width=1.5),
                    nonselection_glyph=Scatter(x="x", y="y", marker="circle", size=11, fill_color="#ffffff", fill_alpha=0.25,
                                               line_color=CHOSEN, line_width=2))
        add(self.names, Text(x="x", y="y", text="text", text_color="#ffffff", text_font_size="12px", x_offset="off", y_offset=-8,
                             text_align="align", **plate))
        self.move = PointDrawTool(renderers=[drawn], add=False, name="move")
        self.pan, self.zoom = PanTool(name="pan"), WheelZoomTool(name="zoom", zoom_on_axis=False, speed=1 / 800)
        self.plot.add_tools(self.move, self.pan, self.zoom)
        self.plot.toolbar.active_scroll = self.zoom
        self.plot.toolbar.active_drag = self.pan
        self.plot.toolbar.logo = None

    # ---- what is seen --------------------------------------------------------------------------
    def draw_things(self, things: Iterable[Thing], chosen: Thing | None, troubled: set) -> None:
        """All outlines but the chosen one's, with the names of what they are; troubled: places of those that are marked."""
        data: dict[str, list] = {key: [] for key in self.outlines.data}
        labels: dict[str, list] = {key: [] for key in self.labels.data}
        spots: dict[str, list] = {"x": [], "y": [], "colour": []}
        across = self.reach() / REACH
        for one in things:
            if not one.points or (chosen is not None and one.place == chosen.place):
                continue
            bad = one.place in troubled
            colour = TROUBLE if bad else one.colour
            if one.form in ("point", "corners"):
                for x, y in one.points:
                    _append(spots, x=x, y=y, colour=colour)
            else:
                xs, ys = lines(one)
                _append(data, xs=xs, ys=ys, colour=colour, wide=2.4 if bad else 1.6, fill=0.10 if one.closed else 0.0)
            if one.form != "line" or bad:
                x, y = min(one.points, key=lambda p: p[1])
                # of names that would lie upon one another the first is shown
                if bad or not any(abs(x - u) < 8 * len(one.label) * across and abs(y - v) < 18 * across
                                  for u, v in zip(labels["x"], labels["y"])):
                    align, off = self._beside(x, 8)
                    _append(labels, x=x, y=y, text=one.label, colour=colour, align=align, off=off)
        self._set(self.outlines, data)
        self._set(self.labels, labels)
        self._spots = spots
        self._mark()

    def draw_seen(self, shown: Any) -> None:
        """What was worked out of the camera, boxes and the sun (`preview.Shown`)."""
        data: dict[str, list] = {key: [] for key in self.seen.data}

        def line(points, colour, wide=1.4, strong=1.0):
            if points is not None and len(points) > 1:
                _append(data, xs=[float(p[0]) for p in points], ys=[float(p[1]) for p in points], colour=colour, wide=wide,
                        dark=wide + 1.8, strong=strong)

        if shown is not None:
            if shown.horizon is not None:
                line(shown.horizon, "#f2f2f2", 1.2)
            for one in shown.lines:
                line(one["towards"], COLOURS[one["axis"]], 1.0, 0.55)
            for polylines in shown.hidden.values():
                for one in polylines:
                    line(one, COLOURS["shapes"], 1.0, 0.35)
            for polylines in shown.wireframes.values():
                for one in polylines:
                    line(one, COLOURS["shapes"])
            for polylines in shown.shafts.values():
                for one in polylines:
                    line(one, "#ffd27a", 1.1)
            for sun in shown.suns.values():
                line(sun.get("post"), COLOURS["sun"])
                line(sun.get("post_shadow"), "#101010", 2.0)
                for one in (sun.get("arrow"), sun.get("post_ray")):
                    if one:
                        line(one, COLOURS["sun"], 2.6)
                        line(arrow_head(one), COLOURS["sun"], 2.6)
        self._set(self.seen, data)
        self._vanishing = dict(shown.vanishing_points) if shown is not None else {}
        self._mark()

    _spots: dict = {"x": [], "y": [], "colour": []}
    _vanishing: dict = {}

    def _mark(self) -> None:
        spots = {key: list(values) for key, values in self._spots.items()}
        for axis, point in self._vanishing.items():
            # one far outside would make everything tiny if the view followed it; it is simply not seen
            if point is not None and abs(point[0]) < 1e6 and abs(point[1]) < 1e6:
                _append(spots, x=float(point[0]), y=float(point[1]), colour=COLOURS.get(axis, "#ffffff"))
        self._set(self.spots, spots)

    def hold(self, points, names=(), closed: bool = False, chosen: int | None = None) -> None:
        """Shows these points as what can be moved, the line through them, and their names."""
        xs, ys = [float(p[0]) for p in points], [float(p[1]) for p in points]
        self._set(self.handles, {"x": xs, "y": ys})
        sides = [self._beside(x, 11) for x in xs] if names else []
        self._set(self.names, {"x": xs if names else [], "y": ys if names else [], "text": list(names),
                               "align": [align for align, _ in sides], "off": [off for _, off in sides]})
        joined = len(points) > 1 and not names
        end = 1 if closed and len(points) > 2 else 0
        self._set(self.active, {"xs": [xs + xs[:end]], "ys": [ys + ys[:end]]} if joined else {"xs": [], "ys": []})
        wanted = [] if chosen is None or chosen >= len(points) else [chosen]
        if self.handles.selected.indices != wanted:
            self.handles.selected.indices = wanted

    def _beside(self, x: float, far: float) -> tuple[str, float]:
        """On which side of a point its name ends or begins, and how far off [CSS pixel]: to the left near the right border."""
        return ("right", -far) if x > NEAR_BORDER * self.width else ("left", far)

    @staticmethod
    def _set(source: ColumnDataSource, data: dict) -> None:
        if source.data != data:
            source.data = data

    # ---- where a click is ----------------------------------------------------------------------
    def reach(self, touch: bool = False) -> float:
        """How close to something a click must be, in the photograph's pixels at this zoom."""
        try:
            across = self.plot.inner_width or USUAL
        except UnsetValueError:  # the browser has not said yet
            across = USUAL
        return abs(self.plot.x_range.end - self.plot.x_range.start) / across * REACH * (2 if touch else 1)

    def middle(self) -> tuple[float, float]:
        """The middle of what is seen of the photograph."""
        x, y = self.plot.x_range, self.plot.y_range
        return ((max(0.0, min(x.start, x.end)) + min(self.width, max(x.start, x.end))) / 2,
                (max(0.0, min(y.start, y.end)) + min(self.height, max(y.start, y.end))) / 2)


def _append(data: dict[str, list], **one) -> None:
    for key, value in one.items():
        data[key].append(value)


def lines(thing: Thing) -> tuple[list[float], list[float]]:
    xs, ys = [p[0] for p in thing.points], [p[1] for p in thing.points]
    return (xs + xs[:1], ys + ys[:1]) if thing.closed else (xs, ys)


def arrow_head(points) -> list | None:
    """Two short lines at the last point."""
    if len(points) < 2:
        return None
    (x0, y0), (x1, y1) = points[-2], points[-1]
    dx, dy = x1 - x0, y1 - y0
    length = (dx * dx + dy * dy) ** 0.5
    if length < 1e-6:
        return None
    size = min(0.25 * length, 40.0) / length
    back = [(x1 - size * (dx + s * 0.5 * dy), y1 - size * (dy - s * 0.5 * dx)) for s in (1, -1)]
    return [back[0], points[-1], back[1]]


def nearest_thing(things: Iterable[Thing], x: float, y: float, reach: float) -> Thing | None:
    """What is drawn nearest to a click, within `reach`; an outline also by its inside, the smallest first."""
    best, least = None, reach
    for one in things:
        d = distance(one, x, y)
        if d is not None and d < least:
            best, least = one, d
    if best is not None:
        return best
    inside = [one for one in things if one.closed and _inside(one.points, x, y)]
    return min(inside, key=lambda one: _area(one.points), default=None)


def distance(thing: Thing, x: float, y: float) -> float | None:
    """From a point to what is drawn."""
    points = thing.points
    if not points:
        return None
    if thing.form in ("point", "corners"):
        return min(((px - x) ** 2 + (py - y) ** 2) ** 0.5 for px, py in points)
    return nearest_edge(points, thing.closed, x, y)[1]


def nearest_edge(points, closed: bool, x: float, y: float) -> tuple[int, float]:
    """Index of the edge, by its first point, that is nearest, and how far it is."""
    ends = [*points[1:], points[0]] if closed else points[1:]
    if not ends:
        return 0, ((points[0][0] - x) ** 2 + (points[0][1] - y) ** 2) ** 0.5
    found = []
    for i, ((x0, y0), (x1, y1)) in enumerate(zip(points, ends)):
        dx, dy = x1 - x0, y1 - y0
        squared = dx * dx + dy * dy
        t = 0.0 if squared == 0 else min(1.0, max(0.0, ((x - x0) * dx + (y - y0) * dy) / squared))
        found.append((((x0 + t * dx - x) ** 2 + (y0 + t * dy - y) ** 2) ** 0.5, i))
    best = min(found)
    return best[1], best[0]


def _inside(points, x: float, y: float) -> bool:
    inside, (x0, y0) = False, points[-1]
    for x1, y1 in points:
        if (y1 > y) != (y0 > y) and x < (x0 - x1) * (y - y1) / (y0 - y1) + x1:
            inside = not inside
        x0, y0 = x1, y1
    return inside


def _area(points) -> float:
    return abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(points, [*points[1:], points[0]])))
