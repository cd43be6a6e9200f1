"""The page of `make compare`: one picture of all, and a table of what each takes, does and misses."""

from __future__ import annotations

from typing import Any

import jinja2

from pipeline import paths
from pipeline.reporting.page import number


def compared_page(title: str, rows: list[dict[str, Any]], effects: dict[str, str], facts: dict[str, Any]) -> str:
    """Text of the page; effects: by name, what they mean."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(paths.TEMPLATES), autoescape=True,
                                     undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = number
    return environment.get_template("compare.html").render(title=title, rows=rows, effects=effects, facts=facts)
