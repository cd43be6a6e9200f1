"""One tab: what it shows, and what a person's commands there do to the scene.

The browser sends what a person does as small commands, `{"do": "add", "kind": "box"}`; each has a method `on_...` here. Clicks and
drags in the picture come from Bokeh. Everything shown beside the picture is HTML by templates/annotate/panels.html.
"""

from __future__ import annotations

import json
import logging

from bokeh.core.properties import Dict, Int, String
from bokeh.events import DoubleTap, Press, Tap
from bokeh.model import DataModel

from pipeline.annotate.page import kinds, panels
from pipeline.annotate.page.canvas import Picture
from pipeline.annotate.page.desk import Desk
from pipeline.annotate.page.fields import fields, fog_of_kind, typed
from pipeline.annotate.page.fog_sliders import sliders
from pipeline.annotate.page.painting import Painting
from pipeline.annotate.page.things import Place, at
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
    brush = String(default="off")


class Page(Painting):
    """A tab's state. present() says whether its browser is still there."""

    def __init__(self, desk: Desk, doc, present):
        super().__init__()
        self.desk, self.doc, self.present = desk, doc, present
        self.picture = Picture(*desk.size)
        self.wire = Wire(name="wire")
        self.said = ""
        self.setting = "open" if kinds.is_open(self.data) or "sky" in {
            at(light, ("type",)) for light in kinds.group(self.data, "lights").values()} else "room"
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
        if work != self.on_slide:  # which changes nothing but the picture, and is waited for
            self.draw({"chosen", "state"})

    # ---- commands ------------------------------------------------------------------------------
    def on_choose(self, command) -> None:
        self.on_cancel({})
        self.choose(_place(command.get("place")))

    def on_problem(self, command) -> None:
        """Chooses what a problem is about."""
        place = _place(command.get("place"))
        if place is not None:
            one = panels.thing_of(place, self.things())
            self.on_choose({"place": list(one.place) if one is not None else list(place[:1])})

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
            elif place[-1] == "asymmetry" and at(self.data, place[:-1]) is None:
                document.set(place[:-1], {"type": "henyey_greenstein", "asymmetry": value})
            elif value is None:
                document.remove(place)
            else:
                document.set(place, value)

    def fields(self):
        owner = self.owner()
        return fields(self.data, owner, panels.planes_of(self)) if owner else []

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
            self.desk.show_fog(fog, gains, quickly=True)

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
        if "picture" in what and self.desk.picture is not None:
            self.wire.picture = self.desk.picture_count
            if self.desk.picture_count == 1:
                self.wire.view = "fog"
        if what == {"picture"}:
            return
        every, chosen = self.things(), self.thing()
        if self.chosen is not None and at(self.data, self.chosen) is None:
            self.chosen = self.point = None
        self.wire.brush = self.painting
        if self.painting != "off":
            chosen = None  # nobody moves points under a brush
        self.picture.draw_things(every, chosen, panels.troubled(every, self.desk.problems))
        if "shown" in what:
            self.picture.draw_seen(self.desk.shown)
        if self.adding is not None:
            self.picture.hold(self.draft, closed=False, chosen=self.point)
        else:
            self.picture.hold(chosen.points if chosen else [], chosen.names if chosen else (), bool(chosen and chosen.closed), self.point)
        rendered = panels.render(self, every, self.thing())
        if rendered != self.wire.panels:
            self.wire.panels = rendered


def _place(stated) -> Place | None:
    """A place as the browser states it."""
    if isinstance(stated, list) and 0 < len(stated) <= 12 and all(isinstance(one, (str, int)) and not isinstance(one, bool) for one in stated):
        return tuple(one[:200] if isinstance(one, str) else one for one in stated)
    return None
