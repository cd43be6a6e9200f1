"""T and V of a draft in other fog and other light, at once: closed forms, and what renders said that shadows take.

V is linear in each light, its gain and the albedo, and T a ratio of sums over the lights: both are exact in these. In other
fog closed forms say how T and V differ from the draft's, while shadows take the share of V that they take there.
"""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from pipeline.annotate.preview.drafting import COARSE_GLOW, Draft
from pipeline.errors import InputError
from pipeline.imaging.maps import read_map
from pipeline.physics.composition import INDIRECT_SHARE
from pipeline.physics.visibility import visibility
from pipeline.plugins.base import Medium
from pipeline.plugins.registry import registry
from pipeline.rendering.runs import in_scattering_about
from pipeline.rendering.scattered import Scattered
from pipeline.scene.artefacts import read_file
from pipeline.scene.placed import PlacedScene

#: Of light on its way to surfaces less than this tells nothing; its logarithm stays finite.
LEAST_WAY = 1e-12
#: More light than so many times what there was without fog reaches no surface through it.
MOST_WAY = 100.0
#: Share of light scattered along the ray below which there is nothing to divide by.
NOTHING = 1e-12
#: Kinds of nodes: fogs exp(step) times as dense as the draft's, and fogs of another asymmetry.
DENSITY, PHASE = "density", "phase"
STEPS = tuple(float(k * np.log(3)) for k in range(-3, 4))
ASYMMETRIES = (-0.5, -0.2, 0.1, 0.35, 0.6, 0.8, 0.9)
#: Fogs of another kind that are kept.
MOST_OTHERS = 12


@dataclass(frozen=True)
class Maps:
    """At the draft's size (h, w): mean density (h, w, 1) of the fog along each ray, F (h, w, 3), what fog leaves of light on
    its way to the surface, and J (h, w, 3), the radiance of fog that fills the ray: T = exp(-tau) F, V = (1 - exp(-tau)) J.

    extinction (3,) [1/m]; strengths (3,) by light, times its gain.
    """

    extinction: np.ndarray
    density: np.ndarray
    on_the_way: np.ndarray
    filling: np.ndarray
    strengths: dict[str, np.ndarray]


class _Kept(Scattered):
    """A fog's renders, each read once; in other fog none of them is used but of what is without fog."""

    def __init__(self, draft: Draft):
        super().__init__(draft.build, mixed=False)
        self.images: dict[Any, Any] = {}
        self.glows = dict(draft.glows)
        self.behind = None

    def _image(self, run: str) -> np.ndarray:
        if run not in self.images:
            self.images[run] = super()._image(run)
        return self.images[run]

    def _clear(self, light: str) -> tuple[np.ndarray, float]:
        if ("clear", light) not in self.images:
            self.images["clear", light] = super()._clear(light)
        return self.images["clear", light]

    def in_fog(self, medium: Medium) -> _Kept:
        other = copy.copy(self)
        other._take_fog(medium)
        other.fineness = replace(self.fineness, **COARSE_GLOW)
        other.enclosed, other.factors, other.reflections = self.enclosed.in_fog(medium), {}, {}
        other.glows, other.ways, other.rendered_offs, other.known, other.runs = {}, {}, {}, {}, {}
        other.front = other._view(self.front.full_depth, ...)
        return other


class Sliders:
    """Maps of one draft for any fog of its kind.

    Nodes are fogs so many times as dense, with the draft's phase function, and such with others, as dense as the draft: of
    each light ln(V / scattering_coefficient) at unit strength, and the length of fog, -ln(F) / extinction, that its light has
    come through to the surfaces. Between nodes both are cubic in ln(density) and asymmetry, each channel for itself; what
    the phase function changes counts as the same in thin and dense fog. V is linear in the albedo.
    """

    def __init__(self, draft: Draft):
        self.draft, self.kept = draft, _Kept(draft)
        self.lights = draft.lights
        self.lock = threading.Lock()
        self.extinction = np.add(*draft.medium.coefficients())
        self.strengths = {name: np.asarray(one, float) for name, one in self.kept.strengths.items()}
        #: lights that fog scatters to surfaces: these may get more of them than without
        self.scattered = [name for name in self.lights if self.kept.enclosed.reflects(name)]
        self.radiance = np.asarray(read_map(draft.build.photograph), np.float32) if self.scattered else None
        self.others: dict[str, list[_Node]] = {}
        self.own_rough: dict[str, list[_Node]] = {}
        #: whether all nodes are there
        self.complete = False
        #: without fog: what arrives of each light at the surfaces, its irradiance / pi (h, w, 3)
        self.weights: dict[str, np.ndarray] = {}
        self.nodes: dict[tuple[str, float], list[_Node]] = {}
        self._own(draft)

    @property
    def front_depth(self) -> np.ndarray:
        return self.kept.front.full_depth

    def _own(self, draft: Draft) -> None:
        """The draft's own fog, by what was rendered of it."""
        view, found = self.kept.front, []
        for name in self.lights:
            _, clear, reduced, indirect, reduced_indirect = self.kept._arriving(name, np.exp(-view.optical_depth), view)
            self.weights[name] = np.asarray(clear + INDIRECT_SHARE * indirect, np.float32)
            glow = _unshadowed(self.kept, name) if draft.is_rough else self.kept._by(name, view)
            found.append(_Node.of(self.kept, name, glow, (clear, reduced, indirect, reduced_indirect)))
        self.base = found
        self.nodes[DENSITY, 0.0] = found

    def prepare(self, wanted: Callable[[], bool] = lambda: True) -> None:
        """Works out the nodes, the nearest first, as long as they are wanted; until then pictures are further off."""
        self.rough = self._rough(self.draft.medium)
        for step in sorted(STEPS, key=abs):
            self._add(wanted, (DENSITY, step), lambda: _times(self.draft.medium, float(np.exp(step))))
        own = self.draft.medium.phase().model_dump().get("asymmetry", 0.0)
        for g in sorted(ASYMMETRIES, key=lambda g: abs(g - own)):
            self._add(wanted, (PHASE, g), lambda: altered(self.draft.medium, {"g": g}))
        self.complete = wanted()

    def _add(self, wanted: Callable[[], bool], key: tuple[str, float], fog: Callable[[], Medium]) -> None:
        if wanted() and self.lights and key not in self.nodes:
            found = self._rough(fog())
            # coarse as they are, nodes tell how other fog differs from the draft's
            found = [one.beside(rough, own) for one, rough, own in zip(found, self.rough, self.base)]
            with self.lock:
                self.nodes = {**self.nodes, key: found}

    def _rough(self, medium: Medium, without: Container[str] = ()) -> list[_Node]:
        """A node without renders; `without` closed forms of these lights."""
        kept = self.kept.in_fog(medium.loaded(lambda name: read_file(self.draft.build, name)))
        view = kept.front
        eye = np.exp(-view.optical_depth)
        return [_Node.of(kept, name, _unshadowed(kept, name, name not in without), kept._arriving(name, eye, view)[1:]) for name in self.lights]

    def maps(self, fog: Mapping[str, Any] | None = None, gains: Mapping[str, float] | None = None) -> Maps:
        """fog: values as in the scene file in place of the draft's, as `altered` has them. gains: by light; 1 if absent.

        Raises InputError for values that no fog can have.
        """
        own = self.draft.medium
        medium = own if not fog else altered(own, fog).loaded(lambda name: read_file(self.draft.build, name))
        scattering, extinction = medium.coefficients()[1], np.add(*medium.coefficients())
        strengths = {name: one * float((gains or {}).get(name, 1.0)) for name, one in self.strengths.items()}
        paths, glows = self._between(medium)
        depths = self._density_paths(medium)
        with np.errstate(divide="ignore", invalid="ignore"):
            density = np.where(self.front_depth > 0, depths / self.front_depth, 1.0).astype(np.float32)
        thick = (extinction * depths[..., None]).astype(np.float32)
        filled = -np.expm1(-thick)
        above, below, total = np.zeros_like(filled), np.zeros_like(filled), np.zeros_like(filled)
        for name, path, glow in zip(self.lights, paths, glows):
            strength = strengths[name].astype(np.float32)
            below += strength * self.weights[name]
            least = 0 if name not in self.scattered else -np.inf
            above += strength * self.weights[name] * np.exp(-extinction.astype(np.float32) * np.maximum(path, least))
            total += (strength * scattering.astype(np.float32)) * np.exp(glow)
        with np.errstate(divide="ignore", invalid="ignore"):
            on_the_way = np.where(below > 0, above / below, np.float32(1))
            if self.scattered:
                # as `combined_transmittance`: what is brighter than its light shines itself
                thrown_back = np.minimum(below / np.maximum(self.radiance, 1e-12), 1)
                on_the_way = np.where(on_the_way > 1, np.minimum(1 + (on_the_way - 1) * thrown_back, np.exp(thick)), on_the_way)
        on_the_way[self.kept.without_surface] = 1
        filling = np.where(filled > NOTHING, total / np.maximum(filled, NOTHING), np.float32(0))
        return Maps(extinction, density[..., None], on_the_way, filling, strengths)

    def _density_paths(self, medium: Medium) -> np.ndarray:
        """Integral of the relative density (h, w) [m] up to what is seen."""
        view = self.kept.front
        return view.depth if medium.even else medium.density_path(self.kept.scene.camera.position, view.points)

    def _between(self, medium: Medium) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Of each light the way and ln(V / scattering_coefficient), (h, w, 3) each, in fog between the nodes."""
        own = self.draft.medium
        if _shape(medium) != _shape(own):
            # of another kind or height: by itself, roughly
            found = self._of_another_kind(medium)
            return [one.path for one in found], [one.glow for one in found]
        with np.errstate(divide="ignore"):
            steps = np.log(np.add(*medium.coefficients()) / self.extinction)
        steps = np.clip(np.nan_to_num(steps, neginf=min(STEPS), posinf=max(STEPS)), min(STEPS), max(STEPS))
        nodes = self.nodes
        density = sorted(step for kind, step in nodes if kind == DENSITY)
        paths, glows = [], []
        weighted = [_cubic(density, step) for step in steps]
        changes = self._phase_changes(medium, nodes)
        for index in range(len(self.lights)):
            path, glow = np.empty_like(self.base[index].path), np.empty_like(self.base[index].glow)
            for channel, weights in enumerate(weighted):
                path[..., channel] = sum(w * nodes[DENSITY, x][index].path[..., channel] for x, w in weights)
                glow[..., channel] = sum(w * nodes[DENSITY, x][index].glow[..., channel] for x, w in weights)
            paths.append(path)
            glows.append(glow + changes[index] if changes else glow)
        return paths, glows

    def _phase_changes(self, medium: Medium, nodes: dict) -> list[np.ndarray]:
        """What another asymmetry adds to the logarithm of each light's V (h, w, 3); none for the draft's own."""
        of = [one.phase().model_dump(mode="json") for one in (self.draft.medium, medium)]
        asymmetries = [(g, nodes[PHASE, g]) for kind, g in sorted(nodes) if kind == PHASE]
        if of[0] == of[1] or not asymmetries:
            return []
        known = [g for g, _ in asymmetries]
        first, then = (_cubic(known, one.get("asymmetry", 0.0)) for one in of)
        if of[0]["type"] == "rayleigh":
            first = []
        result = []
        for index, own in enumerate(self.base):
            change = sum(w * nodes[PHASE, g][index].glow for g, w in then)
            result.append(change - (sum(w * nodes[PHASE, g][index].glow for g, w in first) if first else own.glow))
        return result

    def _of_another_kind(self, medium: Medium) -> list[_Node]:
        """Nodes of a fog that varies otherwise than the draft's, by what both have closed forms for; the last ones are kept."""
        key = medium.model_dump_json()
        if key not in self.others:
            scene = self.kept.scene
            rough = {name for name in self.lights for one in (medium, self.draft.medium) if not _is_closed(scene, name, one)}
            if (of_own := str(sorted(rough))) not in self.own_rough:
                self.own_rough[of_own] = self._rough(self.draft.medium, rough)
            pairs = zip(self._rough(medium, rough), self.own_rough[of_own], self.base)
            kept = dict(list(self.others.items())[-MOST_OTHERS:])
            self.others = {**kept, key: [one.beside(other, base) for one, other, base in pairs]}
        return self.others[key]


@dataclass(frozen=True)
class _Node:
    """Of one light in one fog: path (h, w, 3) [m], glow (h, w, 3), float32; see `Sliders`."""

    path: np.ndarray
    glow: np.ndarray

    @classmethod
    def of(cls, kept: _Kept, light: str, glow: np.ndarray, arriving: tuple) -> _Node:
        """glow: V (h, w, 3) at unit strength; arriving: as `Scattered._arriving`, without the strength."""
        clear, reduced, indirect, reduced_indirect = arriving
        eye = np.exp(-kept.front.optical_depth)
        with np.errstate(divide="ignore", invalid="ignore"):
            way = (reduced + INDIRECT_SHARE * reduced_indirect) / ((clear + INDIRECT_SHARE * indirect) * eye)
        way = np.where(np.isfinite(way), np.clip(way, LEAST_WAY, MOST_WAY), 1)
        extinction, scattering = np.maximum(kept.extinction, 1e-30), np.maximum(kept.medium.coefficients()[1], 1e-30)
        path = (-np.log(way) / extinction).astype(np.float32)
        return cls(np.repeat(path, 3, -1) if path.shape[-1] == 1 else path,
                   np.log(np.maximum(glow / scattering, 1e-30)).astype(np.float32))

    def beside(self, rough: _Node, own: _Node) -> _Node:
        """What is exact of `own`, changed as this one differs from the `rough` one of own's fog."""
        return _Node(own.path + self.path - rough.path, own.glow + self.glow - rough.glow)


def _is_closed(scene: PlacedScene, light: str, medium: Medium) -> bool:
    """Whether V without shadows is known of a light in this fog."""
    return not scene.rendered(light) or scene.completes(light, medium)


def _unshadowed(kept: _Kept, light: str, closed: bool = True) -> np.ndarray:
    """V (h, w, 3) at unit strength without shadows; of lights without a closed form in this fog, roughly."""
    scene, view = kept.scene, kept.front
    scattering = kept.medium.coefficients()[1]
    if not scattering.max() > 0:
        return np.zeros((*view.depth.shape, 3))
    if closed and _is_closed(scene, light, kept.medium):
        return kept._without_shadows(light, view)
    rough = in_scattering_about(scene, kept.medium, light, view.directions, view.points)
    return rough[..., None] * scattering / float(scattering.mean())


def _cubic(nodes: list[float], x: float) -> list[tuple[float, np.float32]]:
    """Of the nodes, the (at most) four nearest round x, and their weights in the polynomial through them."""
    x = float(np.clip(x, nodes[0], nodes[-1]))
    count = min(4, len(nodes))
    first = int(np.clip(np.searchsorted(nodes, x) - 2, 0, len(nodes) - count))
    near = nodes[first:first + count]
    return [(node, np.float32(np.prod([(x - other) / (node - other) for other in near if other != node]))) for node in near]


def _times(medium: Medium, factor: float) -> Medium:
    """Fog so many times as dense."""
    if medium.visibility is not None:
        return medium.model_copy(update={"visibility": medium.visibility / factor})
    return medium.model_copy(update={name: [one * factor for one in getattr(medium, name)]
                                     for name in ("absorption_coefficient", "scattering_coefficient")})


def _shape(medium: Medium) -> dict[str, Any]:
    """What of a fog is neither how dense nor how it scatters."""
    aside = {"visibility", "contrast", "single_scattering_albedo", "absorption_coefficient", "scattering_coefficient",
             "phase_function"}
    return {key: value for key, value in medium.model_dump(mode="json").items() if key not in aside}


def altered(medium: Medium, values: Mapping[str, Any]) -> Medium:
    """The fog with some of its values changed.

    values: visibility [m]; albedo, one or one a channel; g, the asymmetry of its phase function; height [m], over which it
    falls to 1/e, or None for even fog; and any other of its parameters as the scene file states them. Raises InputError for
    what no fog can have.
    """
    stated, values = medium.model_dump(mode="json"), dict(values)
    if stated.get("visibility", 0) is None and {"visibility", "albedo"} & set(values):
        absorption, scattering = medium.coefficients()
        extinction = np.add(absorption, scattering)
        stated |= {"absorption_coefficient": None, "scattering_coefficient": None, "visibility": float(visibility(extinction)),
                   "single_scattering_albedo": (scattering / np.maximum(extinction, 1e-300)).tolist()}
    if "g" in values:
        stated["phase_function"] = {"type": "henyey_greenstein", "asymmetry": values.pop("g")}
    if "albedo" in values:
        values["single_scattering_albedo"] = np.broadcast_to(np.asarray(values.pop("albedo"), float), 3).tolist()
    if "height" in values:
        height = values.pop("height")
        if height is not None and medium.type == "homogeneous":
            stated["type"] = "height"
        if height is None and medium.type == "height":
            stated = {key: stated[key] for key in type(medium).model_fields if key in registry("media")["homogeneous"].model_fields}
            stated["type"] = "homogeneous"
        elif height is not None:
            values["scale_height"] = height
    known = registry("media")[stated["type"]]
    for name in values:
        if name not in known.model_fields:
            raise InputError(f"fog of type {stated['type']} has no '{name}'", remedy=f"use one of {', '.join(known.model_fields)}")
    try:
        changed = known.model_validate({**stated, **values})
    except ValidationError as error:
        raise InputError(f"no fog is such as {values}: {error.errors()[0]['msg']}", remedy="keep its values in bounds") from None
    return changed
