"""POV-Ray scenes: one file a run, complete in itself."""

from __future__ import annotations

from typing import Literal

from pipeline.plugins.base import Exporter


class Povray(Exporter):
    """Emits `.pov` files from `templates/`, rendered by POV-Ray 3.7."""

    type: Literal["povray"] = "povray"
