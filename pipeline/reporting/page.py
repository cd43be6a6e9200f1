"""The report as one HTML page, from a template that a scene may replace."""

from __future__ import annotations

import math
from typing import Any

import jinja2
import numpy as np
from jinja2.sandbox import SandboxedEnvironment

from pipeline import paths
from pipeline.errors import InputError
from pipeline.paths import Build


def page(build: Build, **values: Any) -> str:
    """The text of templates/report.html, or of the scene's own, which wins; a mistake in it is one line."""
    environment = SandboxedEnvironment(
        loader=jinja2.FileSystemLoader([build.source / "templates", build.source, paths.TEMPLATES]),
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"number": number, "numbers": numbers}
    template = None
    try:
        template = environment.get_template("report.html")
        return template.render(build=build, **values)
    except jinja2.TemplateSyntaxError as error:
        raise InputError(f"template does not parse ({error.message})", remedy="mend this line",
                         place=f"{error.filename}:{error.lineno}") from None
    except (jinja2.UndefinedError, jinja2.exceptions.SecurityError) as error:
        raise InputError(f"template fails ({error})", place=template.filename if template else "report.html",
                         remedy="use the values that are there") from None


def number(value: Any, digits: int = 3) -> str:
    """`value` to so many digits as a person writes it; a dash for None."""
    if value is None:
        return "–"
    value = float(value)
    if not math.isfinite(value):
        return "∞" if value > 0 else "–"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    text = np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def numbers(values: Any, digits: int = 3) -> str:
    """Three channels, or one number where they agree."""
    texts = [number(v, digits) for v in values]
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)
