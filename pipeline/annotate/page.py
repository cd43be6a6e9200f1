"""One tab: what is chosen and being drawn there, and what its clicks and keys do to the scene.

The browser sends what a person does as small commands, `{"do": "add", "kind": "box"}`; each has a method `on_...` here. Clicks and
drags in the picture come from Bokeh. Everything shown beside the picture is HTML by templates/annotate/panels.html.
"""

from __future__ import annotations

import json
import logging
import math
from typing import Any

from bokeh.core.properties import Dict, Int, String
from bokeh.events import DoubleTap, Press, Tap
from bokeh.model import DataModel

from pipeline.annotate import kinds, panels
from pipeline.annotate.desk import Desk
from pipeline.annotate.fields import fields, fog_of_kind, typed
from pipeline.annotate.canvas import Picture, nearest_edge, nearest_thing
from pipeline.annotate.fog_sliders import sliders
from pipeline.annotate.things import Place, Thing, at, things
from pipeline.errors import InputError

log = logging.getLogger(__name__)
#: Characters of a command: a dragged outline of 2000 points does not come this way.
LONGEST_COMMAND = 20_000


class Wire(DataModel):
    """What goes between the browser and a page: a command, and panels as HTML by the id of their element."""

    asked = String(default="")
    panels = Dict(String, String, default={})
    picture = Int(default=0)
    view = String(default="clear")


class Page:
    """A tab's state. on_screen() says whether its browser is still there."""

    def __init__(self, desk: Desk, doc, on_screen, studio=None):
        self.desk, self.doc, self.on_screen, self.studio = desk, doc, on_screen, studio
        self.picture = Picture(*desk.size)
        self.wire = Wire(name="wire")
        self.chosen: Place | None = None
        self.point: int | None = None
        self.adding: kinds.Kind | None = None
        self.draft: list[tuple[float, float]] = []
        self.options: dict[str, Any] = {}
        self.corner: str | None = None
        self.said = ""
        self.setting = "open" if kinds.is_open(self.data) or "sky" in {
            at(light, ("type",)) for light in kinds.group(self.data, "lights").values()} else "room"
        self.last_tap: tuple[float, float] | None = None
        self.waiting: set[str] = set()
        self.wire.on_change("asked", lambda _, __, text: self.asked(text))
        self.picture.handles.on_change("data", lambda _, __, data: self.dragged(data))
        self.picture.handles.selected.on_change("indices", lambda _, __, indices: self.picked(indices))
        self.picture.plot.on_event(Tap, lambda event: self.guarded(self.tapped, event.x, event.y))
        # a button that is held a while is no less a click
        self.picture.plot.on_event(Press, lambda event: self.guarded(self.tapped, event.x, event.y))
        self.picture.plot.on_event(DoubleTap, lambda event: self.guarded(self.double_tapped, event.x, event.y))
        self.picture.plot.tags = [self.wire]
        doc.add_root(self.picture.plot)
        desk.join(self)
        self.draw({"document", "shown", "picture", "state"})

    # ---- what comes from the desk --------------------------------------------------------------
    def told(self, what: set[str]) -> None:
        """Something changed; drawn at the next turn of the server's loop, all of it at once."""
        first = not self.waiting
        self.waiting |= what
        if first:
            self.doc.add_next_tick_callback(self._draw_waiting)

    def _draw_waiting(self) -> None:
        what, self.waiting = self.waiting, set()
        self.draw(what)

    def leave(self) -> None:
        self.desk.leave(self)

    # ---- what comes from the browser -----------------------------------------------------------
    @property
    def may_write(self) -> bool:
        return self.desk.pen is self

    def asked(self, text: str) -> None:
        if not text or len(text) > LONGEST_COMMAND:
            return
        try:
            command = json.loads(text)
            work = getattr(self, f"on_{command.get('do')}", None) if isinstance(command, dict) else None
        except ValueError:
            return
        if work is not None:
            self.guarded(work, command)

    def guarded(self, work, *arguments) -> None:
        """What a person did wrong is said on the page, in the command line's words."""
        self.said = ""
        try:
            work(*arguments)
        except InputError as error:
            self.said = str(error)
        except Exception:
            log.exception("a command failed")
            self.said = "that went wrong; the terminal says more"
        self.draw({"chosen", "state"})

    @property
    def data(self) -> dict:
        return self.desk.document.data

    def things(self) -> list[Thing]:
        return things(self.data)

    def thing(self) -> Thing | None:
        return next((one for one in self.things() if one.place == self.chosen), None)

    # ---- drawing -------------------------------------------------------------------------------
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
        if self.last_tap is None or math.hypot(self.last_tap[0] - x, self.last_tap[1] - y) > self.picture.reach():
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
        limit = 1e6
        points = [(min(limit, max(-limit, u)), min(limit, max(-limit, v))) for u, v in points]
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
    def on_choose(self, command) -> None:
        self.on_cancel({})
        self.choose(_place(command.get("place")))

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
        points = [[round(x, 1), round(y, 1)] for x, y in self.draft]
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

    def on_problem(self, command) -> None:
        """Chooses what a problem is about."""
        place = _place(command.get("place"))
        if place is not None:
            one = panels.thing_of(place, self.things())
            self.on_choose({"place": list(one.place) if one is not None else list(place[:1])})

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

    def on_point(self, command) -> None:
        """The next or the previous point."""
        count = len(self.draft) if self.adding is not None else len(self.thing().points) if self.thing() else 0
        if count:
            step = -1 if command.get("by") == -1 else 1
            self.point = (self.point + step) % count if self.point is not None else (0 if step == 1 else count - 1)

    def on_walk(self, command) -> None:
        """The next or the previous thing of the list."""
        every = [one.place for one in self.things()]
        if every:
            step = -1 if command.get("by") == -1 else 1
            now = every.index(self.chosen) if self.chosen in every else (-1 if step == 1 else 0)
            self.on_choose({"place": list(every[(now + step) % len(every)])})

    def on_setting(self, command) -> None:
        """Of a scene that is neither yet: a room, or the open air, where sky and ground shine instead of walls."""
        if command.get("value") not in ("room", "open") or kinds.settled(self.data):
            return
        self.desk.must_hold_pen(self)
        self.on_cancel({})
        self.setting = command["value"]
        lights = {name: light for name, light in kinds.group(self.data, "lights").items()
                  if at(light, ("type",)) not in ("ambient", "sky", "ground")}
        wanted = {"reflected": "ambient"} if self.setting == "room" else {"sky": "sky", "ground": "ground"}
        with self.desk.changing(self) as document:
            document.set(("lights",), lights | {name: {"type": type} for name, type in wanted.items()})

    def on_front(self, command) -> None:
        """A region that lies over all others: later ones in the file lie over earlier ones."""
        if self.chosen and self.chosen[:2] == ("depth", "regions"):
            regions = dict(at(self.data, self.chosen[:2]))
            regions[self.chosen[2]] = regions.pop(self.chosen[2])
            with self.desk.changing(self) as document:
                document.set(self.chosen[:2], regions)

    def on_undo(self, command) -> None:
        self.desk.must_hold_pen(self)
        if self.adding is not None and self.draft:
            self.draft = self.draft[:-1]
        elif self.desk.document.undo():
            self._after_history()

    def on_redo(self, command) -> None:
        self.desk.must_hold_pen(self)
        if self.desk.document.redo():
            self._after_history()

    def _after_history(self) -> None:
        self.point = None
        if self.chosen is not None and at(self.data, self.chosen) is None:
            self.choose(None)
        self.desk.changed()

    def on_field(self, command) -> None:
        """A value was typed. Only what the panel offers can be set."""
        place = _place(command.get("place"))
        field = next((one for one in self.fields() if one.place == place), None)
        if field is None:
            return
        value = typed(field, command.get("value"))
        if value == field.value:
            return
        with self.desk.changing(self) as document:
            if place == ("fog", "type"):
                document.set(("fog",), fog_of_kind(at(self.data, ("fog",), {}), value or "homogeneous"))
            elif value is None:
                document.remove(place)
            else:
                document.set(place, value)

    def fields(self):
        owner = self.owner()
        return fields(self.data, owner, panels.planes_of(self)) if owner else []

    def owner(self) -> Place | None:
        thing = self.thing()
        return thing.owner if thing is not None else self.chosen

    def on_rename(self, command) -> None:
        owner, name = self.owner(), str(command.get("value", "")).strip()[:80]
        if not owner or not name or name == owner[-1] or not isinstance(owner[-1], str):
            return
        with self.desk.changing(self) as document:
            document.rename(owner, name)
        if self.chosen is not None:
            self.chosen = (*owner[:-1], name, *self.chosen[len(owner):])

    def on_slide(self, command) -> None:
        """A slider moves: the picture follows from the maps that are there, and the scene stays as it is."""
        slider = self._slider(command)
        if slider is not None:
            fog, gains = dict(self.desk.tried[0]), dict(self.desk.tried[1])
            slider.tries(slider.value_of(command.get("value")), fog, gains)
            self.desk.show_fog(fog, gains)

    def on_slid(self, command) -> None:
        """The slider was let go: its value goes into the scene."""
        slider = self._slider(command)
        if slider is not None:
            value = slider.value_of(command.get("value"))
            with self.desk.changing(self) as document:
                document.set(*slider.change(self.data, value))

    def _slider(self, command):
        return next((one for one in sliders(self.data) if one.name == command.get("name")), None)

    def on_view(self, command) -> None:
        if command.get("value") in ("clear", "fog", "result"):
            self.wire.view = command["value"]

    def on_pen(self, command) -> None:
        self.desk.give_pen(self)

    def on_keep(self, command) -> None:
        self.desk.must_hold_pen(self)
        if command.get("value") == "theirs":
            self.desk.take_theirs()
        else:
            self.desk.save(overwrite=True)

    def on_save(self, command) -> None:
        self.desk.must_hold_pen(self)
        self.desk.save()

    def on_render(self, command) -> None:
        self.desk.must_hold_pen(self)
        self.desk.save()
        if self.desk.render is not None:
            self.desk.render.start()

    def on_stop(self, command) -> None:
        if self.desk.render is not None:
            self.desk.render.stop()

    # ---- what is shown -------------------------------------------------------------------------
    def draw(self, what: set[str]) -> None:
        every, chosen = self.things(), self.thing()
        if self.chosen is not None and at(self.data, self.chosen) is None:
            self.chosen = self.point = None
        self.picture.draw_things(every, chosen, panels.troubled(every, self.desk.problems))
        if "shown" in what:
            self.picture.draw_seen(self.desk.shown)
        if self.adding is not None:
            self.picture.hold(self.draft, closed=False, chosen=self.point)
        else:
            self.picture.hold(chosen.points if chosen else [], chosen.names if chosen else (), bool(chosen and chosen.closed), self.point)
        if "picture" in what and self.desk.picture is not None:
            self.wire.picture = self.desk.picture_count
            if self.desk.picture_count == 1:
                self.wire.view = "fog"
        rendered = panels.render(self, every, chosen)
        if rendered != self.wire.panels:
            self.wire.panels = rendered


def _place(stated) -> Place | None:
    """A place as the browser states it."""
    if isinstance(stated, list) and 0 < len(stated) <= 12 and all(isinstance(one, (str, int)) and not isinstance(one, bool) for one in stated):
        return tuple(one[:200] if isinstance(one, str) else one for one in stated)
    return None
