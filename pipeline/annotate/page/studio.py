"""The scenes that are open in this server, each on a desk of its own, and their pictures."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from pipeline.annotate.page.desk import Desk, photograph_picture
from pipeline.annotate.written.document import SceneDocument
from pipeline.annotate.page.html import page_template
from pipeline.annotate.page.page import Page
from pipeline.annotate.preview.preview import Preview
from pipeline.annotate.page.render_job import RenderJob
from pipeline.annotate.page.things import at
from pipeline.errors import InputError
from pipeline.paths import Build, inside

log = logging.getLogger(__name__)
#: Pixels of the picture on the page: light and fog are worked out at that size too.
PIXELS = 1_000_000


class Studio:
    """All desks by the name of their scene. `preview(scenes, name, folder)` makes what works out the fog."""

    def __init__(self, scenes: Path, builds: Path, folder: Path, first: str, loop, preview: Callable | None = None):
        self.scenes, self.builds, self.folder, self.first, self.loop = scenes, builds, folder, first, loop
        self.make_preview = preview or (lambda scenes, name, folder: Preview(scenes, name, folder, PIXELS / 1e6))
        self.desks: dict[str, Desk] = {}
        self.clear: dict[str, bytes] = {}
        self.desk(first)

    def desk(self, name: str) -> Desk:
        """The scene's desk; opened when it is asked for first. InputError as the scene's loader says."""
        if name not in self.desks:
            build = Build(name, None, self.scenes, self.builds)
            document = SceneDocument.open(build.scene_file)
            photograph = at(document.data, ("photograph",), {})
            path = inside(build, str(at(photograph, ("file",), "")))
            size, self.clear[name] = photograph_picture(path, str(at(photograph, ("colour_space",), "auto")),
                                                        float(at(photograph, ("max_megapixels",), 100.0)), PIXELS)
            desk = Desk(document, self.make_preview(self.scenes, name, self.folder / name), size, self.loop.add_callback, self.loop.call_later)
            desk.render = RenderJob(build, lambda call: self.loop.add_callback(call), lambda desk=desk: desk.tell("state", "picture"))
            self.desks[name] = desk
        return self.desks[name]

    def open_page(self, doc) -> None:
        """Fills Bokeh's document of a new tab."""
        context = doc.session_context
        stated = context.request.arguments.get("scene", [self.first.encode()])[-1]
        name = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else str(stated)
        doc.template = page_template()
        try:
            desk = self.desk(name)
        except InputError as error:
            doc.title = "not opened"
            doc.template_variables.update(scene=name[:80], refused=str(error), width=1, height=1)
            return
        doc.title = f"{name}: annotate"
        doc.template_variables.update(scene=name, refused="", width=desk.size[0], height=desk.size[1])
        page = Page(desk, doc, lambda: _on_screen(context))
        doc.on_session_destroyed(lambda _: page.leave())

    def picture(self, scene: str, name: str) -> bytes | None:
        """JPEG of the photograph (clear), its fog in the preview (fog) or as it was rendered (result)."""
        desk = self.desks.get(scene)
        if desk is None:
            return None
        if name == "result":
            return desk.render.picture
        return {"clear": self.clear.get(scene), "fog": desk.picture}.get(name)

    def look(self) -> None:
        for desk in self.desks.values():
            desk.look()

    def close(self) -> None:
        for desk in self.desks.values():
            desk.render.stop()
            desk.close()


def _on_screen(context) -> bool:
    """Whether a browser is connected; one that has just asked for the page counts until it has had time to."""
    session = context.session
    if session is None:
        return not context.destroyed
    return session.connection_count > 0 or session.milliseconds_since_last_unsubscribe < 0
