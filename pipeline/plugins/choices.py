"""One field type per plugin kind: any registered plugin, told apart by its `type`."""

from __future__ import annotations

from typing import Annotated, Any, Union

from pydantic import Field

from pipeline.plugins.base import registry


def choice(kind: str, estimates: str | None = None) -> Any:
    """Annotated union over all plugins of `kind` (estimators: of what they estimate), for a model's field."""
    classes = tuple(c for c in registry(kind).values() if estimates is None or c.estimates == estimates)
    return classes[0] if len(classes) == 1 else Annotated[Union[classes], Field(discriminator="type")]


PhaseFunctionChoice = choice("phase_functions")
