"""Base classes of all plugins; `registry` finds the plugins.

A plugin has two duties: its value in Python and its statement in POV-Ray. It is a pydantic model of
its parameters (defaults, bounds and units stand in the model) with a `type` that names it, plus the
methods its kind asks for below. Parameters may be given as annotations of the photograph or directly in
3D; `placed(world)` turns the first into the second, so that everything after the geometry stage sees
world metres only.

Packages outside this repository add plugins through Python entry points: group `fog.KIND`, the entry's
name being the plugin's type and its value the class; the template `NAME.inc` lies beside the class's module.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, model_validator
from pydantic_core import PydanticCustomError

from pipeline.errors import InputError, nearest
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane, polygon_normal
from pipeline.geometry.raycast import first_hits


def parameter(default: Any = ..., unit: str = "", **constraints):
    """A documented parameter of a plugin: default, unit and bounds in one place."""
    return Field(default, json_schema_extra={"unit": unit} if unit else None, **constraints)


def mistake(problem: str, remedy: str, at: tuple = ()) -> PydanticCustomError:
    """What a validator raises about a scene; it is said with the line of the key `at` below its model."""
    return PydanticCustomError(
        "mistake", "{problem}; {remedy}", {"problem": problem, "remedy": remedy, "at": at})


def _unit_length(v: list[float]) -> list[float]:
    norm = float(np.linalg.norm(v))
    if not norm > 0:
        raise mistake(f"{v} points nowhere", "give a direction of some length")
    return [float(x) / norm for x in v]


#: A number whose square, and the difference of two of them, are still numbers in any unit that people use.
Finite = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
#: A length [m] by which may be divided.
Length = Annotated[float, Field(ge=1e-6, le=1e7)]
Colour = Annotated[list[Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)]],
                   Field(min_length=3, max_length=3)]
Reflectance = Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=3, max_length=3)]
#: Coordinates [m] reach so far.
FARTHEST = 1e7
Vector = Annotated[list[Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]],
                   Field(min_length=3, max_length=3)]
Direction = Annotated[Vector, AfterValidator(_unit_length)]
Pixel = Annotated[list[Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]],
                  Field(min_length=2, max_length=2)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,39}$")]
#: A fog's name may state numbers, such as height_a0.05_d0.20.
FogName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]*(\.[A-Za-z0-9_-]+)*$", max_length=40)]


class Model(BaseModel):
    """Any piece of a scene file: no unread keys, no silent changes."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _no_unread_keys(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                known = list(cls.model_fields)
                raise mistake("unknown key", f"use one of {', '.join(known)}" + nearest(str(key), known),
                              at=(key,))
        return data


class Plugin(Model):
    kind: ClassVar[str]
    type: str

    @classmethod
    def type_name(cls) -> str:
        return cls.model_fields["type"].annotation.__args__[0]

    @classmethod
    def template_name(cls) -> str:
        return f"{cls.kind}/{cls.type_name()}.inc"

    @classmethod
    def template_folder(cls) -> Path:
        """Where a plugin from outside keeps its template: beside its module."""
        return Path(inspect.getfile(cls)).parent

    def statement(self) -> dict[str, Any]:
        """Values that the template needs beyond the plugin's own parameters."""
        return {}

    def files(self) -> list[str]:
        """Names of the files in the scene's folder that it is made from."""
        return []

    def loaded(self, read: Callable[[str], bytes]) -> "Plugin":
        """The same plugin with its files' contents, for `read` gives a file's bytes by its name."""
        return self


@dataclass
class World:
    """What annotations are resolved against: the camera and the planes known so far, by name."""

    camera: Camera
    planes: dict[str, Plane] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    residuals: dict[str, dict[str, float]] = field(default_factory=dict)

    def add_faces(self, name: str, shape: "Shape") -> None:
        """Names the planes of a placed shape, as NAME.FACE, for what is placed on them later."""
        for face, corners in shape.faces().items():
            self.planes[f"{name}.{face}"] = Plane(corners.mean(0), polygon_normal(corners))

    def plane(self, name: str, asked_by: str) -> Plane:
        try:
            return self.planes[name]
        except KeyError:
            raise InputError(
                f"{asked_by} lies on '{name}', which no shape before it has",
                remedy=f"use one of {', '.join(sorted(self.planes)) or '(none yet)'}"
                + nearest(name, list(self.planes)),
            ) from None


class Shape(Plugin):
    """Something solid that the fog ends at and that casts shadows."""

    kind: ClassVar[str] = "shapes"
    albedo: Reflectance | None = parameter(
        None, "1", description="diffuse albedo for all its faces, where it is known; estimated otherwise"
    )

    def placed(self, name: str, world: World) -> "Shape":
        """The same shape in world metres; adds its faces' planes and residuals to `world`."""
        raise NotImplementedError(type(self).__name__)

    def faces(self) -> dict[str, np.ndarray]:
        """Planar faces (n, 3) [m] by name, of the placed shape; normals follow no convention.

        A shape with curved parts approximates them here (they serve as planes to place things on and
        carry the estimated albedo) and overrides `intersect`.
        """
        raise NotImplementedError(type(self).__name__)

    def intersect(self, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance [m] (inf where missed) to the first hit of rays (..., 3), and the face's index (-1)."""
        return first_hits(origin, directions, list(self.faces().values()))

    #: A shape seen from inside only (a room's shell) throws no shadow into itself.
    casts_shadow: ClassVar[bool] = True


@dataclass(frozen=True)
class Reaching:
    """Light at points (...): irradiance (...) facing it, unit directions (..., 3) in which it travels, and path (...) [m] that
    it has come through fog."""

    irradiance: np.ndarray
    travels: np.ndarray
    path: np.ndarray


class Light(Plugin):
    """A source of light. Its strength in the photograph's unit is estimated unless given.

    `strength_name` says what one unit of it is: radiance, intensity or irradiance.
    """

    kind: ClassVar[str] = "lights"
    strength_name: ClassVar[str]
    #: Where POV-Ray renders its T and V. Elsewhere `in_scattering` and `arrival` give them without shadows,
    #: and a pair of small renders what shadows take away from V where `shaded` says that they may.
    rendered: ClassVar[Literal["always", "indoors", "never"]] = "always"
    #: Whether its template states light sources, so that it can be rendered alone on the photograph's surfaces.
    light_source: ClassVar[bool] = True
    #: Whether its glow has no edges but those of depth, so that it may be found small and enlarged.
    smooth: ClassVar[bool] = True
    #: Whether `in_scattering` over a whole photograph (H, W) integrates along few of its rays.
    on_few_rays: ClassVar[bool] = False
    #: Which part of the sphere it fills, so that things round the fog may hide it; None for lamps and suns.
    comes_from: ClassVar[Literal["above", "below", "all"] | None] = None
    gain: float = parameter(1.0, "1", ge=0, le=1e6, allow_inf_nan=False,
                            description="relights the fog: scales this light after estimation")

    def placed(self, name: str, world: World) -> "Light":
        raise NotImplementedError(type(self).__name__)

    def given_strength(self) -> list[float] | None:
        """Strength (3,) stated by hand in the scene, or None where it is to be estimated."""
        return getattr(self, self.strength_name)

    def emitting_polygon(self) -> np.ndarray | None:
        """(n, 3) [m], where the light can be seen in the photograph, or None."""
        return None

    def bulbs(self) -> tuple[np.ndarray, float]:
        """Positions (n, 3) [m] and common radius [m] of small lamps that can be seen in the photograph."""
        return np.zeros((0, 3)), 0.0

    def sub_light_count(self) -> int:
        """POV-Ray lights that it is stated as; what a render costs grows with it."""
        return 1

    def in_scattering(self, medium: "Medium", eye: np.ndarray, directions: np.ndarray, depth: np.ndarray
                      ) -> np.ndarray:
        """Unoccluded V (..., 3) at unit strength, along unit rays (..., 3) from `eye` (3,) to depth (...) [m]."""
        raise NotImplementedError(type(self).__name__)

    def glow(self, medium: "Medium", eye: np.ndarray, directions: np.ndarray, depth: np.ndarray, tolerance: float
             ) -> np.ndarray:
        """`in_scattering` to a relative tolerance, where it is an integral that may be finer or coarser."""
        return self.in_scattering(medium, eye, directions, depth)

    def midpoint(self) -> np.ndarray | None:
        """(3,) [m], for which the whole light may stand (Zhao et al. 2013, eq. 5), or None where it stands nowhere."""
        return None

    def finer(self, step: float, extinction: float) -> "Light":
        """The light, or the same of small lights that span at most `step` optical depths in fog of `extinction` [1/m].

        In half-shadow a part of a lamp shines, and T depends on where that part is: the denser the fog, the finer.
        """
        return self

    def coarser(self, count: int) -> "Light":
        """The light of at most `count`^2 small lights, where only what shadows take from its glow is asked."""
        return self

    def parts(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Centres (n, 3) [m] and areas (n,) [m^2] of its area in about `count`^2 parts, and its normal; None without one."""
        return None

    def integrates(self, medium: "Medium") -> bool:
        """Whether `way_transmittance` is known in this fog."""
        return self.midpoint() is not None

    def way_transmittance(self, medium: "Medium", points: np.ndarray, normals: np.ndarray, step: float) -> np.ndarray:
        """Transmittance (..., 3) on the light's way to directly lit points (..., 3) [m], averaged over all of it.

        normals (..., 3): of the surfaces, towards their lit side. step: most optical depths that one part of the light
        may span. Nothing stands between light and point: in half-shadow the part that shines may be nearer or farther.
        """
        return np.exp(-medium.optical_depth(self.midpoint(), points))

    def completes(self, medium: "Medium", faces: Sequence[np.ndarray]) -> bool:
        """Whether `in_scattering` is known although the light is rendered: renders then only say what shadows of these faces
        (n, 3) [m] take from it, and near the light nothing depends on samples."""
        return False

    def dimmed_by(self, faces: Sequence[np.ndarray]) -> bool:
        """Whether faces (n, 3) [m] that cast shadows may keep it from the fog."""
        return bool(len(faces))

    def arrival(self, medium: "Medium", points: np.ndarray, normals: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray]:
        """What arrives at surfaces (..., 3) [m] without shadows, at unit strength, for T.

        Irradiance (...) on the side of `normals` (..., 3), and the light's transmittance (..., 3) on its way.
        """
        raise NotImplementedError(type(self).__name__)

    def shaded(self) -> bool:
        """Whether things in the photograph may keep it from the fog, for a light that is not rendered."""
        return False

    def hidden_count(self, medium: "Medium", eye: np.ndarray) -> int:
        """How many of its lamps are left out, for the fog before them lets nothing of theirs through."""
        return 0

    def shadow_worth(self, eye: np.ndarray) -> float:
        """What its shadows in the fog are worth at unit strength, against those of other lights; inf: always a render."""
        return float("inf")

    def shaded_part(self, eye: np.ndarray) -> "Light":
        """The light, or that part of it, whose shadows are worth a render."""
        return self

    def entry_path(self, points: np.ndarray, medium: "Medium") -> np.ndarray:
        """Integral of the relative density [m], (...), on the light's way to directly lit points, as far as the
        transmittance render leaves it out."""
        return np.zeros(np.shape(points)[:-1])

    def incident(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unoccluded irradiance (...) facing the light at unit strength, and the path [m] it came.

        A cheap estimate (the light's midpoint) for exposures and for pixels that no light reaches directly.
        """
        raise NotImplementedError(type(self).__name__)


    def reaching(self, points: np.ndarray) -> Reaching | None:
        """What reaches points (..., 3) [m] in the fog straight from the light as nothing stood in its way, at unit strength;
        None for one that comes from no place of its own. As rough as `incident`: light that fog scatters again, and the
        surfaces that no pixel shows, are found from it.
        """
        middle = self.midpoint()
        if middle is None:
            return None
        irradiance, path = self.incident(points)
        offset = points - middle
        return Reaching(irradiance, offset / np.maximum(np.linalg.norm(offset, axis=-1, keepdims=True), 1e-12), path)


class PhaseFunction(Plugin):
    """Distribution of scattered light over the sphere. Integrates to 1."""

    kind: ClassVar[str] = "phase_functions"

    def value(self, cosine: np.ndarray) -> np.ndarray:
        """p [1/sr]; `cosine` of the angle between propagation directions, 1 = forward."""
        raise NotImplementedError(type(self).__name__)


class Medium(Plugin):
    """Fog: spectral coefficients times a relative density in space.

    Templates state the macros `Fog_Extinction()` and `Fog_Scattering(Samples)` (media statements), the colour
    `Fog_Scatter` [1/m], and for light that comes from outside the fog (`run.shafts`) the functions
    `Fog_Density(X, Y, Z)` and `Fog_Density_Path(X0, Y0, Z0, X1, Y1, Z1)` [m], its integral along a segment,
    and `Fog_Highest`, which the density never passes, where that may be more than 1.
    """

    kind: ClassVar[str] = "media"
    #: Whether its density depends on height alone.
    layered: ClassVar[bool] = False
    #: Whether its density is 1 everywhere.
    even: ClassVar[bool] = False

    def coefficients(self) -> tuple[np.ndarray, np.ndarray]:
        """absorption_coefficient, scattering_coefficient, each (3,) [1/m], where relative density is 1."""
        raise NotImplementedError(type(self).__name__)

    def density(self, points: np.ndarray) -> np.ndarray:
        """Relative density at `points` (..., 3) [m], (...)."""
        return np.ones(np.shape(points)[:-1])

    def density_path(self, origin: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Integral of the relative density from `origin`, (3,) or (..., 3), to `points`, (...) [m]."""
        raise NotImplementedError(type(self).__name__)

    def density_along(self, origin: np.ndarray, directions: np.ndarray, distances: np.ndarray) -> np.ndarray:
        """Integral of the relative density from `origin` to each of (..., n) rising distances, (..., n) [m].

        `directions` (..., 3). A medium whose integral is numerical overrides this with one pass along the ray.
        """
        points = origin + directions[..., None, :] * distances[..., None]
        return self.density_path(np.broadcast_to(np.asarray(origin, float), points.shape), points)

    def daylight_path(self, points: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Integral of the relative density, (...) [m], on the way of light from outside the fog to `points`.

        direction (3,) or (..., 3): in which the light travels. 0 where the fog has no top: then what the
        photograph shows of sun and sky has crossed all of it already.
        """
        return np.zeros(np.broadcast_shapes(np.shape(points), np.shape(direction))[:-1])

    def paths_from(self, origin: np.ndarray, reach: float, count: int) -> Callable[[np.ndarray], np.ndarray]:
        """`density_path` from `origin` (3,) to points at most `reach` [m] away, made ready for about `count` of them."""
        return lambda points: self.density_path(origin, points)

    def daylight(self, direction: np.ndarray, count: int) -> Callable[[np.ndarray], np.ndarray]:
        """`daylight_path` along `direction` (3,) as a function of points, made ready for about `count` of them."""
        return lambda points: self.daylight_path(points, direction)

    def skylight(self, extinctions: Sequence[float], count: int) -> list[Callable[[np.ndarray], np.ndarray]]:
        """For each extinction [1/m] a function of points, made ready for about `count` of them: integral of the
        relative density [m], straight up through level layers that would let through as much of an even sky."""
        return [self.daylight(np.array([0.0, -1.0, 0.0]), count)] * len(extinctions)

    def top(self) -> float | None:
        """Height [m] above which there is no fog, or None where it has no end."""
        return None

    def bends(self) -> list[float]:
        """Heights [m] between which a few nodes follow the density, where it depends on height."""
        return []

    def longest_step(self) -> float:
        """Length [m] of steps by which a midpoint rule follows the density; inf where it is even."""
        return float("inf")

    def render_step(self) -> float:
        """Length [m] of steps by which POV-Ray's midpoint rule follows the density; inf where it is even."""
        return self.longest_step()

    def side_files(self) -> dict[str, bytes]:
        """Files that the medium's statement reads, by name; they are written beside the `.pov` files."""
        return {}

    def phase(self) -> PhaseFunction:
        return self.phase_function

    def optical_depth(self, origin: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(..., 3), between two points."""
        absorption, scattering = self.coefficients()
        return self.density_path(origin, points)[..., None] * (absorption + scattering)

    def is_clear(self) -> bool:
        """True where there is nothing to render: the photograph comes back unchanged."""
        absorption, scattering = self.coefficients()
        return not np.any(absorption + scattering > 0)


class Estimator(Plugin):
    """A way to find light strengths or a sun direction from the photograph."""

    kind: ClassVar[str] = "estimators"
    estimates: ClassVar[Literal["illumination", "sun_direction"]]


class Exporter(Plugin):
    """Writes the placed scene in another program's language."""

    kind: ClassVar[str] = "exporters"
    #: Light types that its language can state. One that renders the chain itself states them by templates.
    states: ClassVar[frozenset[str]] = frozenset()

    def export(self, name: str, description) -> dict[str, str | bytes]:
        """Files by name of one pipeline.plugins.description.Description, the scene called `name` and its side files."""
        raise NotImplementedError(type(self).__name__)

    def scale(self, extent: float) -> float:
        """Units of the other program a metre [1/m], for a scene of this radius [m] round the camera."""
        raise NotImplementedError(type(self).__name__)


class Baseline(Plugin):
    """Fog as others put it into a photograph, without light and shape: what ours is held against by `make compare`."""

    kind: ClassVar[str] = "baselines"
