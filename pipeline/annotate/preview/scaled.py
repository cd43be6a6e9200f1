"""A scene's annotations as of a smaller copy of its photograph."""

from __future__ import annotations

from typing import Any

from pipeline.plugins.base import Model
from pipeline.scene.depth_section import DepthMap, DepthSection


def scaled(value: Any, factor: float) -> Any:
    """A model of the scene, or lists and dicts of such, with all that is annotated in pixels times `factor`.

    Whole numbers are settings, not places; a depth map from elsewhere has pixels of its own.
    """
    if isinstance(value, list):
        return [scaled(one, factor) for one in value]
    if isinstance(value, dict):
        return {key: scaled(one, factor) for key, one in value.items()}
    if not isinstance(value, Model) or isinstance(value, DepthMap):
        return value
    changed = {}
    for name, field in type(value).model_fields.items():
        one = getattr(value, name)
        changed[name] = _times(one, factor) if (field.json_schema_extra or {}).get("unit") == "pixel" else scaled(one, factor)
    if isinstance(value, DepthSection) and value.refine.radius:
        changed["refine"] = value.refine.model_copy(update={"radius": max(1, round(value.refine.radius * factor))})
    return value.model_copy(update=changed)


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_times(one, factor) for one in value]
    if isinstance(value, dict):
        return {key: _times(one, factor) for key, one in value.items()}
    return value * factor if isinstance(value, float) else value
