"""One field type per plugin kind: any registered plugin, told apart by its `type`."""

from __future__ import annotations

from typing import Annotated, Any, Union

from pydantic import BeforeValidator, Field

from pipeline.errors import nearest
from pipeline.plugins.base import mistake
from pipeline.plugins.registry import registry


def choice(kind: str, estimates: str | None = None) -> Any:
    """Annotated union over all plugins of `kind` (estimators: of what they estimate), for a model's field."""
    classes = [c for c in registry(kind).values() if estimates is None or c.estimates == estimates]
    names = sorted(c.type_name() for c in classes)

    def of_known_type(value: Any) -> Any:
        """Asks for a `type` even where there is but one: a plugin installed later may bring a second."""
        if isinstance(value, dict):
            allowed = f"one of {', '.join(names)}"
            if "type" not in value:
                raise mistake("'type' is missing", f"add 'type:' with {allowed}")
            if value["type"] not in names:
                stated = str(value["type"])
                raise mistake(f"type '{stated}' is not known", f"use {allowed}" + nearest(stated, names),
                              at=("type",))
        return value

    one_of = Annotated[Union[tuple(classes)], Field(discriminator="type")] if len(classes) > 1 else classes[0]
    return Annotated[one_of, BeforeValidator(of_known_type)]


PhaseFunctionChoice = choice("phase_functions")
