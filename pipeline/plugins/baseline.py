"""What a baseline is given, and what it states of itself.

A baseline is a method or a tool from elsewhere that puts fog into a photograph. It is run as it is meant to be run, with the
scene's visibility where it takes one, and with nothing that a user of it would not have.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from pipeline.plugins.base import Baseline

#: What one can look for in the picture of a method, or use of it, in the table's order.
EFFECTS = {
    "depth": "farther is foggier", "lamps' glow": "lamps glow in the fog", "shafts": "sunlight stands in it",
    "desaturation": "colours fade with distance", "brightened shadows": "shadows grow brighter with distance",
    "interior": "light of rooms: lamps and windows, and what walls reflect", "heterogeneous": "fog may differ in space",
    "maps out": "gives maps to a compositor", "metres": "takes metres: visibility or coefficients"}
Effect = Literal["depth", "lamps' glow", "shafts", "desaturation", "brightened shadows", "interior", "heterogeneous",
                 "maps out", "metres"]


@dataclass(frozen=True)
class Wanted:
    """A foggy picture (h, w, 3), linear, that a baseline's parameters may be fitted to, at pixels `counted` (h, w).

    what: "ground truth", or "our result" where there is none. shrunk: any picture of the photograph's size as large as it.
    """

    what: str
    picture: np.ndarray
    counted: np.ndarray
    shrunk: Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ClearView:
    """A clear photograph, and what the scene says of it.

    radiance (H, W, 3): linear, scene-referred. encoded (H, W, 3) uint8: sRGB, clipped at white. depth (H, W) [m] along the
    ray, as estimated. sky (H, W). optical_depth (H, W, 3): of the fog along each ray. scattered_share (3,): the fog's
    single_scattering_albedo. visibility [m]. intrinsics (3, 3) [pixel].
    """

    radiance: np.ndarray
    encoded: np.ndarray
    depth: np.ndarray
    sky: np.ndarray
    optical_depth: np.ndarray
    scattered_share: np.ndarray
    visibility: float
    intrinsics: np.ndarray
    wanted: Wanted


@dataclass(frozen=True)
class Foggy:
    """A baseline's picture (H, W, 3): linear, or uint8 in sRGB; and the parameters that it was made with."""

    picture: np.ndarray
    parameters: dict[str, Any] = field(default_factory=dict)


class OtherFog(Baseline):
    """Base of all baselines."""

    title: ClassVar[str]
    #: Package without which it cannot be run; where one lacks, it is left out by name.
    package: ClassVar[str | None] = None
    effects: ClassVar[frozenset[Effect]]

    @classmethod
    def missing(cls) -> bool:
        """Whether its package is not installed. Nothing is imported."""
        return cls.package is not None and importlib.util.find_spec(cls.package) is None

    def foggy(self, view: ClearView) -> Foggy:
        raise NotImplementedError(type(self).__name__)
