"""Ground truth of a modelled photograph in fog: the model itself with fog in it, rendered by POV-Ray, and light of all orders.

What the eye sees of a group of lights is the sum of

- surfaces and lamps through the fog, and the lamps' light that fog scatters once: one render of the model with a medium;
- light that surfaces or fog sent into the fog before, the integral of scattering(x) T(x) J(x) along the eye ray. J(x), what
  arrives at x from everywhere but straight from lamps, by the phase function towards the eye, is gathered by rays from a
  grid of points through the same model and fog. Between surfaces POV-Ray's radiosity carries light, through fog that dims it,
  scatters the lamps' light and glows by the J found so far; a few rounds, each adding one more order of scattering.

Nothing here knows of boxes, regions, estimated lights or the pipeline's maps. Only the statement of fog in POV-Ray's language
(tested against quadrature by itself) is shared.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from pipeline.imaging.maps import read_map
from pipeline.imaging.photograph import averaged
from pipeline.paths import INCLUDES
from pipeline.plugins.base import Medium
from pipeline.rendering.emit import Templates
from tests.validation.models import Group, Model
from tests.validation.povray import povray

#: Optical depth beyond which an eye ray gathers nothing: exp(-14) = 1e-6.
DEEPEST = 14.0
#: Nodes of the integral along an eye ray: Gauss-Legendre, exact to rounding for a smooth J times exp(-14 x).
ALONG = 24
#: What is this much darker than the others is a point within something solid.
INSIDE = 0.02


@dataclass(frozen=True)
class Quality:
    """size [pixel]: longer side of the picture; rays: a side in each pixel; directions: from each point; rounds of scattering;
    share: of the model's points where an eye ray is lit; count: POV-Ray's radiosity rays."""

    size: int = 128
    rays: int = 2
    directions: int = 128
    rounds: int = 3
    share: float = 1.0
    count: int = 50
    coarser: int = 1


def in_fog(model: Model, medium: Medium | None, quality: Quality = Quality()) -> np.ndarray:
    """(h, w, 3), linear, photo unit: the model's photograph in this fog, averaged over pixels; the clear one without."""
    scale = quality.size / max(model.camera.width, model.camera.height)
    width, height = (max(1, round(n * scale)) for n in (model.camera.width, model.camera.height))
    total, groups = np.zeros((height, width, 3)), []
    with tempfile.TemporaryDirectory(prefix="truth-") as folder:
        for group in model.groups:
            groups.append(_Group(model, group, medium, quality, Path(folder), (width, height)))
            total += groups[-1].seen()
        if medium is not None and model.photograph is not None:
            total += groups[0].smoothed(in_fog(model, None, quality))
    return total


class _Group:
    """One group of lights in the fog."""

    def __init__(self, model: Model, group: Group, medium: Medium | None, quality: Quality, folder: Path, size):
        self.model, self.group, self.medium, self.quality, self.folder = model, group, medium, quality, folder
        self.size = size
        self.camera = model.camera.resized(*(n * quality.rays for n in size))
        self.nodes = tuple(axis[::quality.coarser] if len(axis[::quality.coarser]) > 1 else axis[[0, -1]]
                           for axis in model.nodes)
        self.statement = "" if medium is None else self._statement()
        extinction = 0.0 if medium is None else float(np.sum(medium.coefficients(), 0).min())
        #: [m] where rays end that meet nothing: no farther than one sees, or few of their samples would lie near
        self.reach = min(model.farthest, DEEPEST / max(extinction, 1e-12)) if extinction else model.farthest
        self.scattering = np.zeros(3) if medium is None else medium.coefficients()[1]

    def seen(self) -> np.ndarray:
        """(h, w, 3), what the eye sees of this light."""
        glow = self._light_in_fog() if np.any(self.scattering > 0) else None
        print("  what the eye sees", file=sys.stderr, flush=True)
        cache = self.folder / "indirect.rca"
        # as the photograph itself: light between surfaces at half the size first, then direct light with all lamps
        glowing = None if glow is None or self.group.clear else glow[0]
        small = [max(1, n * self.quality.rays // 2) for n in self.size]
        self._render(small, self._radiosity(0.01) + self._fog(4, glowing), {**self.group.switches, **self.model.quick},
                     "+RFO", f"+RF{cache}")
        samples = max(1, round(self.group.samples * self.quality.share))
        picture = self._render((self.camera.width, self.camera.height),
                               self._radiosity(1.0, "pretrace_start 1 always_sample off") + self._fog(samples, None),
                               self.group.switches, "+RFI", f"+RF{cache}")
        if glow is not None:
            picture += self._scattered(glow[1])
        width, height = self.size
        return picture.reshape(height, self.quality.rays, width, self.quality.rays, 3).mean((1, 3))

    def smoothed(self, clear: np.ndarray) -> np.ndarray:
        """(h, w, 3) to add to the foggy picture, whose few rays a pixel miss what is fine: what the clear one by the same rays
        (h, w, 3) lacks of the photograph, as far as fog before it lets that through. Nothing on average."""
        width, height = self.size
        through = np.exp(-self.medium.optical_depth(self.camera.position, self.camera.position + self._depth()[..., None]
                                                    * self.camera.directions(self.camera.pixel_centres())))
        mean = through.reshape(height, self.quality.rays, width, self.quality.rays, 3).mean((1, 3))
        return mean * (averaged(read_map(self.model.photograph).astype(float), self.size) - clear)

    def _light_in_fog(self) -> tuple[np.ndarray, np.ndarray]:
        """What arrives at the points, evenly weighted and by the phase function towards the eye, each (points, 3)."""
        found: list[np.ndarray] = []
        for n in range(1 if self.group.clear else self.quality.rounds):
            print(f"  light in the fog, round {n + 1}", file=sys.stderr, flush=True)
            arriving = self._arriving(found[-1].mean(1) if found else None)
            found.append(arriving)
        if len(found) > 2:
            # each round adds less than the one before, by the same share: the rest of the series
            steps = [float(np.linalg.norm(b - a)) for a, b in zip(found, found[1:])]
            share = min(steps[-1] / max(steps[-2], 1e-30), 0.9)
            arriving = found[-1] + (found[-1] - found[-2]) * share / (1 - share)
        return arriving.mean(1), self._towards_eye(arriving)

    # ---- light that arrives in the fog -----------------------------------------------------------------------
    def _points(self) -> np.ndarray:
        return np.stack(np.meshgrid(*self.nodes, indexing="ij"), -1).reshape(-1, 3)

    def _directions(self) -> np.ndarray:
        """(n, 3), evenly over the sphere (Fibonacci's spiral)."""
        k = np.arange(self.quality.directions) + 0.5
        y, turn = 1 - 2 * k / self.quality.directions, np.pi * (1 + 5**0.5) * k
        round_ = np.sqrt(1 - y * y)
        return np.stack([round_ * np.cos(turn), y, round_ * np.sin(turn)], -1)

    def _arriving(self, glow: np.ndarray | None) -> np.ndarray:
        """Radiance (points, directions, 3) that arrives at each point against each direction, lamps themselves left out."""
        points, directions = self._points(), self._directions()
        statement = self._mesh_camera(points, directions) + self._radiosity(0.2, "pretrace_start 0.2")
        if not self.group.clear:
            statement += self._fog(16, glow)
        else:
            statement += self._backdrop()
        # in one row: POV-Ray 3.7's mesh camera mixes up the rays of a picture of several
        seen = self._render((len(directions) * len(points), 1), statement,
                            {**self.group.switches, **self.model.quick, "Emitters_Seen": 0})
        seen = seen.reshape(len(points), len(directions), 3)
        # a point within something solid sees next to nothing: its neighbours stand for it
        level = seen.mean((1, 2))
        inside = (level < INSIDE * np.median(level)).reshape([len(a) for a in self.nodes])
        if inside.any() and not inside.all():
            nearest = ndimage.distance_transform_edt(inside, return_distances=False, return_indices=True)
            seen = seen.reshape(*inside.shape, *seen.shape[1:])[tuple(nearest)].reshape(seen.shape)
        return seen

    def _towards_eye(self, arriving: np.ndarray) -> np.ndarray:
        """J (points, 3): what arrives, weighted by the phase function towards the eye."""
        away = self.model.camera.position - self._points()
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        # directions point to where light comes from; it travels against them
        weight = self.medium.phase().value(-away @ self._directions().T)
        weight /= weight.sum(1, keepdims=True)
        return np.einsum("pd,pdc->pc", weight, arriving)

    def _scattered(self, towards_eye: np.ndarray) -> np.ndarray:
        """(h, w, 3) at all rays: the integral of scattering T J along them."""
        position, directions = self.camera.position, self.camera.directions(self.camera.pixel_centres())
        reach = self._depth()
        x, w = np.polynomial.legendre.leggauss(ALONG)
        field = towards_eye.reshape(*(len(a) for a in self.nodes), 3)
        total = np.zeros((*reach.shape, 3))
        for row in range(len(reach)):
            s = reach[row][:, None] * (x + 1) / 2
            points = position + directions[row][:, None] * s[..., None]
            path = self.medium.density_along(position, directions[row], s)
            through = np.exp(-path[..., None] * np.sum(self.medium.coefficients(), 0))
            place = np.stack([np.interp(points[..., i], *((a, np.arange(len(a))) if a[0] < a[-1] else
                                                          (a[::-1], np.arange(len(a))[::-1])))
                              for i, a in enumerate(self.nodes)])
            arriving = np.stack([ndimage.map_coordinates(field[..., c], place, order=1, mode="nearest") for c in range(3)], -1)
            density = self.medium.density(points)[..., None] * self.scattering
            total[row] = (density * through * arriving * w[:, None]).sum(1) * reach[row][:, None] / 2
        return total

    def _depth(self) -> np.ndarray:
        """(h, w) [m] at all rays: how much longer a clear render gets by a medium that only shines."""
        shine = f"media {{ emission rgb 0.1 / {self.model.metre} intervals 1 samples 1 method 2 jitter 0 }}\n"
        flat = "global_settings { radiosity { count 1 recursion_limit 1 pretrace_start 1 pretrace_end 1 media off } }\n"
        size = self.camera.width, self.camera.height
        switches = {**self.group.switches, **self.model.quick, "Emitters_Seen": 0}
        with_, without = (self._render(size, flat + self._backdrop() + media, switches) for media in (shine, ""))
        return np.clip(10 * (with_ - without)[..., 1], 0, self.reach)

    # ---- statements in POV-Ray's language --------------------------------------------------------------------
    def _statement(self) -> str:
        absorption, scattering = self.medium.coefficients()
        templates, reach = Templates(), 4 * self.model.farthest
        height = float(self.model.camera.position[1])
        context = {"run": {"kind": "in_scattering", "shafts": False}, "channels": [],
                   "bounds": {"lowest": height - reach, "highest": height + reach}}
        include = (INCLUDES / "fog_scattering.inc").read_text(encoding="utf-8")
        for name, data in self.medium.side_files().items():
            (self.folder / name).write_bytes(data)
        return (f"#ifndef (Metre) #declare Metre = {self.model.metre}; #end\n#declare Fog_Samples = 16;\n{include}"
                + templates.of_plugin(self.medium.phase(), context)
                + templates.of_plugin(self.medium, {**context, "absorption": absorption.tolist(),
                                                    "scattering": scattering.tolist()}))

    def _fog(self, samples: int, glow: np.ndarray | None) -> str:
        """The fog, lit at so many points along each ray; its own glow (points, 3) by the light that arrives there."""
        if self.medium is None:
            return self._backdrop()
        media = f"Fog_Scattering({samples})\n" + (self._glow(glow) if glow is not None else "")
        if self.group.container is None:
            return self.statement + media + self._backdrop()
        low, high = (_vector(np.array(corner) + aside) for corner, aside in zip(self.group.container, (1e-3, -1e-3)))
        return (self.statement + f"box {{ {low} * Metre, {high} * Metre hollow pigment {{ rgbt 1 }}"
                f" finish {{ ambient 0 diffuse 0 }} interior {{ {media} }} }}\n" + self._backdrop())

    def _glow(self, glow: np.ndarray) -> str:
        """Media that shine by scattering times `glow`, on an even grid between the nodes' ends."""
        low, high = (np.array([axis[end] for axis in self.nodes]) for end in (0, -1))
        count = np.array([min(64, 2 * len(axis)) for axis in self.nodes])
        even = [np.interp(np.linspace(a, b, n), *((axis, np.arange(len(axis))) if a < b else (axis[::-1], np.arange(len(axis))[::-1])))
                for a, b, n, axis in zip(low, high, count, self.nodes)]
        place = np.stack(np.meshgrid(*even, indexing="ij"))
        points = np.stack(np.meshgrid(*(np.linspace(a, b, n) for a, b, n in zip(low, high, count)), indexing="ij"), -1)
        density = self.medium.density(points.reshape(-1, 3)).reshape(count)
        field = glow.reshape(*(len(axis) for axis in self.nodes), 3)
        statements = []
        for channel in range(3):
            values = density * self.scattering[channel] * ndimage.map_coordinates(field[..., channel], place, order=1)
            highest = float(values.max()) or 1.0
            name = f"glow_{channel}.df3"
            flipped = values[tuple(slice(None, None, 1 if b > a else -1) for a, b in zip(low, high))]
            code = np.round(flipped / highest * 65535).astype(">u2")
            # x runs fastest in the file
            (self.folder / name).write_bytes(count.astype(">u2").tobytes() + code.transpose(2, 1, 0).tobytes())
            # a value stands at the lower corner of its cell
            size = np.abs(high - low) * count / (count - 1)
            colour = [highest * (channel == c) for c in range(3)]
            statements.append(f"media {{ emission rgb {_vector(colour)} / Metre method 2 jitter 0 intervals 8 samples 1\n  density {{"
                              f" density_file df3 \"{name}\" interpolate 1 scale {_vector(size)} * Metre"
                              f" translate {_vector(np.minimum(low, high))} * Metre }} }}\n")
        return "".join(statements)

    def _backdrop(self) -> str:
        """Where rays end that meet nothing: POV-Ray's fog there would have no end."""
        eye, radius = self.model.camera.position * self.model.metre, self.reach * self.model.metre
        return (f"sphere {{ {_vector(eye)}, {radius} hollow no_shadow pigment {{ rgb {_vector(self.group.sky)} }}"
                " finish { ambient 0 diffuse 0 emission 1 } }\n")

    def _radiosity(self, end: float, more: str = "pretrace_start 0.16") -> str:
        media = "off" if self.group.clear or self.medium is None else "on"
        return (f"global_settings {{ radiosity {{ media {media} count {self.quality.count} error_bound 0.6"
                f" recursion_limit {self.model.bounces} pretrace_end {end} {more} }} }}\n")

    def _mesh_camera(self, points: np.ndarray, directions: np.ndarray) -> str:
        """One ray from each point along each direction: the middle and the normal of a large triangle."""
        aside = np.cross(directions, np.where(np.abs(directions[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]]))
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        beside = np.cross(aside, directions)
        corners = np.stack([aside, (-aside + 3**0.5 * beside) / 2, (-aside - 3**0.5 * beside) / 2], 1)
        places = (points * self.model.metre)[:, None, None] + corners
        rows = "\n".join("triangle{<%.6g,%.6g,%.6g>,<%.6g,%.6g,%.6g>,<%.6g,%.6g,%.6g>}" % tuple(one)
                         for one in places.reshape(-1, 9))
        return f"camera {{ mesh_camera {{ 1 0 mesh {{ {rows} }} }} }}\n"

    def _render(self, size: tuple[int, int], statement: str, switches: dict[str, float], *options: str) -> np.ndarray:
        """(h, w, 3) of the model with this at its end."""
        (self.folder / "in_fog.inc").write_text(statement, encoding="utf-8")
        image = self.folder / "image.exr"
        povray(self.model.file, image, *size, *options, f"+L{self.folder}", "Declare=In_Fog=1",
               *(f"Declare={key}={value}" for key, value in switches.items()))
        return read_map(image).astype(float)


def _vector(values) -> str:
    return "<" + ",".join(repr(float(v)) for v in values) + ">"
