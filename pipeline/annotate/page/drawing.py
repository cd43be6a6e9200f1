"""Drawing in the picture: what clicks, drags and keys make of the points of what is chosen or being added."""

from __future__ import annotations

import math
from typing import Any

from pipeline.annotate.page import kinds
from pipeline.annotate.page.canvas import Picture, nearest_edge, nearest_thing
from pipeline.annotate.page.desk import Desk
from pipeline.annotate.page.things import Place, Thing, at, things
from pipeline.errors import InputError

#: Farthest from the photograph's corner that a point can be [pixel], as the scene file has it.
FARTHEST = 1e6


class Drawing:
    """What is chosen and what is being drawn in one tab. `draw` and `guarded` are the page's.

    chosen: the place of a thing, or of a section; point: index of one of its points. adding: what is being drawn, draft its
    points so far, options what was picked for it. corner: which corner a click gives to what is chosen.
    """

    desk: Desk
    picture: Picture

    def __init__(self):
        self.chosen: Place | None = None
        self.point: int | None = None
        self.adding: kinds.Kind | None = None
        self.draft: list[tuple[float, float]] = []
        self.options: dict[str, Any] = {}
        self.corner: str | None = None
        self.last_tap: tuple[float, float] | None = None

    @property
    def may_write(self) -> bool:
        return self.desk.pen is self

    @property
    def data(self) -> dict:
        return self.desk.document.data

    def things(self) -> list[Thing]:
        return things(self.data)

    def thing(self) -> Thing | None:
        return next((one for one in self.things() if one.place == self.chosen), None)

    def owner(self) -> Place | None:
        """What the chosen thing is part of."""
        thing = self.thing()
        return thing.owner if thing is not None else self.chosen

    # ---- clicks and drags ----------------------------------------------------------------------
    def tapped(self, x: float, y: float) -> None:
        if not (math.isfinite(x) and math.isfinite(y)):
            return
        thing, reach, self.last_tap = self.thing(), self.picture.reach(), (x, y)
        if self.adding is not None:
            self._draw_point(x, y, reach)
            return
        if thing is not None:
            near = [i for i, p in enumerate(thing.points) if math.hypot(p[0] - x, p[1] - y) <= reach]
            if near:
                self.point = near[0]
                return
            if self.corner is not None and self.may_write:
                self._set_points(thing, [*thing.points, (x, y)], [*thing.names, self.corner])
                self._next_corner()
                return
        found = nearest_thing(self.things(), x, y, reach)
        self.choose(found.place if found else None)

    def _draw_point(self, x: float, y: float, reach: float) -> None:
        kind = self.adding
        if kind.form == "outline" and len(self.draft) >= 3 and math.hypot(self.draft[0][0] - x, self.draft[0][1] - y) <= reach:
            self.on_finish({})
            return
        if self.draft and math.hypot(self.draft[-1][0] - x, self.draft[-1][1] - y) < 0.05:
            return
        self.draft.append((x, y))
        if len(self.draft) == kind.first and kind.form in ("line", "point", "corners"):
            self.on_finish({})

    def double_tapped(self, x: float, y: float) -> None:
        """Bokeh says it of two quick clicks wherever they were: at two places they are two clicks."""
        if self.last_tap is None or math.hypot(self.last_tap[0] - x, self.last_tap[1] - y) > self.picture.reach() / 3:
            self.tapped(x, y)
            return
        if self.adding is not None:
            if len(self.draft) >= self.adding.first:
                self.on_finish({})
            return
        thing = self.thing()
        if thing is None or thing.form not in ("outline", "path") or not self.may_write:
            return
        index, far = nearest_edge(thing.points, thing.closed, x, y)
        if far <= self.picture.reach():
            points = [*thing.points[:index + 1], (x, y), *thing.points[index + 1:]]
            self.point = index + 1
            self._set_points(thing, points)

    def dragged(self, data) -> None:
        """Points were moved in the browser, by mouse, finger or arrow keys."""
        points = list(zip([float(x) for x in data["x"]], [float(y) for y in data["y"]]))
        thing = self.thing()
        before = self.draft if self.adding is not None else list(thing.points) if thing is not None else []
        if len(points) != len(before) or points == [tuple(p) for p in before] or not all(map(math.isfinite, sum(points, ()))):
            return
        if self.adding is not None:
            self.draft = points
            self.draw({"chosen"})
        elif thing is not None:
            self.guarded(self._set_points, thing, points)

    def picked(self, indices) -> None:
        self.point = indices[-1] if indices else None

    def _set_points(self, thing: Thing, points, names=None) -> None:
        points = [(min(FARTHEST, max(-FARTHEST, u)), min(FARTHEST, max(-FARTHEST, v))) for u, v in points]
        value = thing.value(points, names)
        with self.desk.changing(self) as document:
            if thing.form == "corners" and names is None:
                for name, one in value.items():
                    if one != at(self.data, (*thing.place, name)):
                        document.set((*thing.place, name), one)
            elif thing.form == "corners":
                for name in set(thing.names) - set(value):
                    document.remove((*thing.place, name))
                for name, one in value.items():
                    if one != at(self.data, (*thing.place, name)):
                        document.set((*thing.place, name), one)
            else:
                document.set(thing.place, value)

    def _next_corner(self) -> None:
        thing = self.thing()
        wanted = [] if thing is None else [name for name in thing.wanted if name not in thing.names]
        self.corner = wanted[0] if wanted else None

    def choose(self, place: Place | None) -> None:
        if place != self.chosen:
            self.chosen, self.point, self.corner = place, None, None

    # ---- commands ------------------------------------------------------------------------------
    def on_add(self, command) -> None:
        kind = kinds.KINDS.get(str(command.get("kind")))
        if kind is None:
            return
        self.desk.must_hold_pen(self)
        if not kinds.fits(kind, self.chosen, self.data):
            raise InputError(f"{kind.title} belongs to something", remedy="choose a region first" if kind.of[:1] == ("depth",)
                             else "outline the sun's window first")
        of = self.chosen
        self.adding, self.draft, self.options = kind, [], {"of": of, "width": self.picture.width}
        if kind.form == "corners":
            self._corners_begin(kind)
        elif kind.form == "nothing":
            self.on_finish({})
        else:
            self.choose(None)
            self.options["of"] = of

    def _corners_begin(self, kind: kinds.Kind) -> None:
        """A room that is there gets further corners; a box or post begins with its first."""
        room = kinds.first_room(self.data) if kind.name == "room" else None
        if room is not None:
            self.adding = None
            self.chosen, self.point = ("shapes", room, "corners"), None
            if self.thing() is None:
                with self.desk.changing(self) as document:
                    document.set(self.chosen, {})
            self._next_corner()
            return
        self.choose(None)
        self.corner = kinds.NAMES[kind.name][0]

    def on_finish(self, command) -> None:
        """What was drawn goes into the scene, as one step that can be undone."""
        kind = self.adding
        if kind is None:
            self.corner = None
            return
        if len(self.draft) < kind.first:
            raise InputError(f"{kind.title}: {len(self.draft)} of {kind.first} points", remedy="click more, or press Esc")
        points = [[round(x, 1) + 0.0, round(y, 1) + 0.0] for x, y in self.draft]  # + 0.0: no -0.0
        if kind.option == "plane" and not self.options.get("plane"):
            seen = self._plane_under(points)
            if seen is not None:
                self.options["plane"] = seen
        if kind.form == "corners":
            self.options["name"] = self.corner
        drawn = kind.make(self.data, points, self.options)
        with self.desk.changing(self) as document:
            for place in drawn.removed:
                document.remove(place)
            for place, value in drawn.values:
                document.set(place, value)
        again = kind.form in ("line", "point") and kind.name not in ("horizon", "known_length")
        self.draft = []
        if again:
            self.options.pop("edge", None)
            return
        self.adding = None
        self.chosen, self.point = drawn.selected, None
        if kind.form == "corners":
            self._next_corner()

    def _plane_under(self, points) -> str | None:
        """The surface seen in the middle of what was drawn, where the preview knows."""
        known = getattr(self.desk.preview, "plane_at", None)
        if known is None:
            return None
        return known([sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)])

    def on_cancel(self, command) -> None:
        """Esc: first what is being drawn, then what is chosen."""
        if self.adding is None and self.corner is None and command.get("do") == "cancel":
            self.choose(None)
        self.adding, self.draft, self.corner = None, [], None

    def on_option(self, command) -> None:
        name, value = command.get("name"), str(command.get("value", ""))[:80]
        if name == "corner":
            self.corner = value or None
        elif name in ("plane", "edge"):
            self.options[name] = value

    def on_delete(self, command) -> None:
        """The chosen point; without one, or where too few would be left, the chosen thing."""
        if self.adding is not None:
            self.draft = self.draft[:-1]
            return
        thing = self.thing()
        if thing is None:
            if self.chosen is not None:
                self._remove(self.chosen)
            return
        if self.point is not None and len(thing.points) > thing.least:
            points, names = list(thing.points), list(thing.names)
            del points[self.point], names[self.point:self.point + 1]
            self.point = None
            self._set_points(thing, points, names if thing.form == "corners" else None)
            return
        self._remove(thing.owner)

    def on_remove(self, command) -> None:
        """The chosen thing, whatever point is chosen."""
        owner = self.owner()
        if owner is not None:
            self._remove(owner)

    def _remove(self, place: Place) -> None:
        if at(self.data, place) is not None and len(place) > 1:
            with self.desk.changing(self) as document:
                document.remove(place)
        self.choose(None)

    def on_insert(self, command) -> None:
        """A point halfway between the chosen one and the next."""
        thing = self.thing()
        if thing is None or thing.form not in ("outline", "path") or not thing.points:
            return
        i = min(self.point or 0, len(thing.points) - (1 if thing.closed else 2))
        (x0, y0), (x1, y1) = thing.points[i], thing.points[(i + 1) % len(thing.points)]
        self._set_points(thing, [*thing.points[:i + 1], ((x0 + x1) / 2, (y0 + y1) / 2), *thing.points[i + 1:]])
        self.point = i + 1

    def on_here(self, command) -> None:
        """A point in the middle of the view, for those who draw by keys."""
        x, y = self.picture.middle()
        if self.draft:
            x, y = self.draft[-1][0] + 4 * self.picture.reach(), self.draft[-1][1]
        if self.adding is not None or self.corner is not None:
            self.tapped(x, y)
