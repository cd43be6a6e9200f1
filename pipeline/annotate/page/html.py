"""The page itself: templates/annotate/page.html with its style and script, filled by Bokeh when a tab opens."""

from __future__ import annotations

import jinja2
from markupsafe import Markup

from pipeline.paths import TEMPLATES


def page_template() -> jinja2.Template:
    """A template for Bokeh's document: Bokeh gives it its scripts, `scene` is the scene's name."""
    folder = TEMPLATES / "annotate"
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(folder), autoescape=False, trim_blocks=True, lstrip_blocks=True)
    style, script = (Markup((folder / name).read_text(encoding="utf-8")) for name in ("page.css", "page.js"))
    return environment.get_template("page.html", globals={"style": style, "script": script})
