"""What the runs and closed forms of a fog say: V of each light, and T of any lights together."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.geometry.normals import surface_normals
from pipeline.geometry.visibility import visible
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.physics import layers
from pipeline.physics.composition import combined_transmittance
from pipeline.physics.penumbrae import carried
from pipeline.physics.upsampling import Enlargement
from pipeline.plugins.base import Light, Medium
from pipeline.rendering import fineness
from pipeline.rendering.enclosed import Enclosed
from pipeline.rendering.runs import SHADED, SHADOWS, UNSHADED, from_json, glow_size
from pipeline.rendering.view import Remembering, View
from pipeline.scene.artefacts import read_edges, read_fog, read_json, read_placed, read_strengths
from pipeline.side_by_side import side_by_side

#: Below this a half float of POV-Ray has lost digits; the closed form stands in.
FEWEST_DIGITS = 6e-4
#: Share of the strongest V without shadows below which a ratio of two half floats says nothing.
LEAST_UNSHADED = 1e-5
#: So many times fewer rays than a photograph's pixels take as long for a lamp, where each is integrated by itself.
GRID_SAVES = 32
#: Bytes of maps that are worked out while POV-Ray renders.
MOST_BEFOREHAND = 256_000_000
#: Of the densest fog's light the way from the middle has nothing left; no quotient of the two may be infinite.
MOST_OFF_MIDDLE = 1e30


class Scattered:
    """The rendered runs of one fog, read as they are asked for.

    mixed: V and T of a pixel that shows two things are those of both; else of the one in front.

    Of grey fog what does not depend on the lights' colours is found in one channel, (..., 1) where (..., 3) is said.
    """

    def __init__(self, build: Build, mixed: bool = True):
        self.mixed = mixed
        self.build, self.scene, medium = build, read_placed(build), read_fog(build)
        self._take_fog(medium if medium.longest_step() == np.inf else Remembering(medium, self.scene.camera.position))
        self.strengths = read_strengths(build)
        plan = read_json(build.plan)
        self.runs = {data["id"]: from_json(data) for data in plan["runs"]}
        self.fineness = fineness.from_json(plan["fineness"])
        size = self.scene.camera.height, self.scene.camera.width
        self.depth = read_map(build.depth, size).astype(float)
        surfaces = read_map(build.surfaces, size)
        self.faces = np.round(surfaces[..., 0]).astype(int)
        #: the photograph shows a lamp or the open sky there: only the way to the eye counts
        self.without_surface = (surfaces[..., 1] >= 0) | (surfaces[..., 0] < 0)
        self.enclosed = Enclosed(build, self.scene, self.medium, self.fineness.room_directions)
        #: at the size at which glow is found: what surroundings make of light from all sides, in front or behind; V without
        #: shadows; and the light's transmittance on its way to surfaces
        self.factors: dict[tuple[str, bool], np.ndarray] = {}
        self.reflections: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.glows: dict[str, np.ndarray] = {}
        self.ways: dict[str, np.ndarray] = {}
        #: by what renders of their own size say that the latter is off
        self.rendered_offs: dict[str, np.ndarray] = {}
        self.enlargements: dict[tuple, Enlargement] = {}
        self.solid_depths: dict[tuple[int, int], np.ndarray] = {}
        #: what needs no render and was worked out while POV-Ray was at those that are needed
        self.known: dict[tuple, np.ndarray] = {}
        self.edges = read_edges(build)
        front = self.depth if self.edges is None else self.edges.front_depth
        self.front = self._view(front, ...)
        self.behind = None
        if self.edges is not None and self.edges.mixed.any():
            self.behind = self._view(self.edges.behind_depth, np.nonzero(self.edges.mixed))

    def _take_fog(self, medium: Medium) -> None:
        self.medium = medium
        grey = all(np.ptp(coefficient) == 0 for coefficient in medium.coefficients())
        self.channels = slice(0, 1) if grey else slice(None)
        self.extinction = self._own(np.add(*medium.coefficients()))

    def _own(self, values: np.ndarray) -> np.ndarray:
        """Those of the channels (..., 3) that the fog tells apart."""
        return values[..., self.channels]

    def _through(self, path: np.ndarray) -> np.ndarray:
        """Transmittance (..., 3) of so much (...) [m] of the fog where its relative density is 1."""
        return np.exp(path[..., None] * -self.extinction)

    def _view(self, depth: np.ndarray, where) -> View:
        camera, medium = self.scene.camera, self.medium
        directions = camera.directions(camera.pixel_centres())
        points = camera.position + depth[..., None] * directions
        normals = surface_normals(points, camera.position) if self.scene.outdoors else None
        points, chosen = points[where], directions[where]
        return View(depth, where, depth[where], chosen, points,
                    normals[where] if normals is not None else -chosen,
                    medium.density_path(camera.position, points)[..., None] * self.extinction)

    def beforehand(self, lights: list[str], surviving: bool = True) -> "Scattered":
        """Works out what needs no render, as far as memory allows; `by` and `transmittance` then take it from there.

        surviving: T as well, where none of it is rendered.
        """
        work: list[tuple[Any, Callable[[], np.ndarray]]] = []
        if surviving and not any(one.kind in ("transmittance", "irradiance") for one in self.runs.values()):
            work.append(("transmittance", partial(self.transmittance, lights)))
        if self.medium.coefficients()[1].max() > 0:
            # T waits for what a room's light of all orders is; so does that light's V
            for light in sorted(lights, key=self.enclosed.reflects):
                work += [((light, view is self.front), partial(self._without_shadows, light, view))
                         for view in (self.front, self.behind) if view is not None and f"in_scattering_{light}" not in self.runs]

        def done(one: tuple[Any, Callable[[], np.ndarray]]) -> None:
            if self._bytes() < MOST_BEFOREHAND:
                self.known[one[0]] = one[1]()

        deque(side_by_side(done, work), maxlen=0)
        return self

    def _bytes(self) -> int:
        return sum(values.nbytes for values in list(self.known.values()))

    def single(self, where: tuple[np.ndarray, np.ndarray]) -> View:
        """The view of some pixels alone, rows and columns (n,); mixed ones by what is in front."""
        front = self.front
        normals = front.normals if self.scene.outdoors else surface_normals(front.points, self.scene.camera.position)
        return View(front.full_depth, where, front.depth[where], front.directions[where], front.points[where],
                    normals[where], front.optical_depth[where])

    def by(self, light: str) -> np.ndarray:
        """In-scattering V of one light at its strength, (H, W, 3)."""
        total = self.strengths[light] * self._by(light, self.front)
        if self.mixed and self.behind is not None:
            where, alpha = self.behind.where, self.edges.alpha[self.behind.where][..., None]
            total[where] = alpha * total[where] + (1 - alpha) * self.behind_by(light)
        return total

    def transmittance(self, lights: list[str]) -> np.ndarray:
        """T of the light that these lights together reflect from each surface, (H, W, 3)."""
        if "transmittance" in self.known:
            return self.known.pop("transmittance")
        total = self._transmittance(lights, self.front)
        if self.mixed and self.behind is not None:
            where, edges = self.behind.where, self.edges
            total[where] = layers.mixed_transmittance(
                edges.alpha[where], edges.front[where], edges.behind[where], total[where],
                self._transmittance(lights, self.behind))
        return total

    def behind_by(self, light: str) -> np.ndarray:
        """V behind what is in front (n, 3), of the pixels that show two things."""
        return self.strengths[light] * self._by(light, self.behind)

    def behind_transmittance(self, lights: list[str]) -> np.ndarray:
        """T of what is behind (n, 3), of the pixels that show two things."""
        return self._transmittance(lights, self.behind)

    def mean_density(self, view: View) -> np.ndarray:
        """Of the fog along each of a view's rays, as a share of what is stated."""
        strongest = int(self.extinction.argmax())
        if not self.extinction[strongest] > 0:
            return np.ones(view.depth.shape)
        return view.optical_depth[..., strongest] / (self.extinction[strongest] * view.depth)

    def _by(self, light: str, view: View) -> np.ndarray:
        """V at unit strength."""
        one, eye = self.scene.lights[light], self.scene.camera.position
        if not self.medium.coefficients()[1].max() > 0:
            return np.zeros((*view.depth.shape, 3))
        if f"in_scattering_{light}" in self.runs:
            run = self.runs[f"in_scattering_{light}"]
            return self._enlarged(run.id, view) / run.exposure
        if self.scene.rendered(light):
            return self._completed(light, view)
        unoccluded = self._remembered(light, view)
        if not self._has_shadows(light):
            return unoccluded
        part = one.shaded_part(eye)
        whole = unoccluded if part is one else self._own(part.in_scattering(self.medium, eye, view.directions, view.depth))
        return unoccluded - whole * (1 - self._unshadowed_share(light, view))

    def _completed(self, light: str, view: View) -> np.ndarray:
        """V of a rendered light whose V without shadows is known: less what two renders say that shadows take.

        Their errors cancel close to the light, where they are largest and nothing stands between.
        """
        known = self._remembered(light, view)
        if not self._has_shadows(light):
            return known
        shaded, unshaded, exposure = self._with_and_without_shadows(light)
        return np.clip(known - self._resampled((unshaded - shaded) / exposure, view), 0, known)

    def _remembered(self, light: str, view: View) -> np.ndarray:
        known = self.known.pop((light, view is self.front), None)
        return self._without_shadows(light, view) if known is None else known

    def _without_shadows(self, light: str, view: View) -> np.ndarray:
        """V (..., 3) at unit strength as nothing stood in the light's way."""
        if self.scene.rendered(light):
            return self._unshadowed(light, view)
        known = self._own(self._closed(self.scene.lights[light], view))
        return known * self._surrounded(light, view) if self.enclosed.changes(light) else known

    def _closed(self, light: Light, view: View) -> np.ndarray:
        camera = self.scene.camera
        if view is self.behind and light.on_few_rays and GRID_SAVES * view.depth.size > view.full_depth.size:
            # over a whole photograph lamps are summed on few rays
            directions = camera.directions(camera.pixel_centres())
            return light.in_scattering(self.medium, camera.position, directions, view.full_depth)[view.where]
        return light.in_scattering(self.medium, camera.position, view.directions, view.depth)

    def _surrounded(self, light: str, view: View) -> np.ndarray:
        """Factor (..., 3) of a light from all sides, for what stands round the fog."""
        key = light, view is self.behind
        if key not in self.factors:
            small = self._small_camera()
            self.factors[key] = self.enclosed.factor(light, small, small.pixel_centres(),
                                                     self._solid_depth(small.width, small.height, view))
        return self._resampled(self.factors[key], view)

    def _reflected(self, light: str, view: View) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance / pi (..., 3) at unit strength of what a room reflects and its fog scatters, in clear air and in fog."""
        if light not in self.reflections:
            self.reflections[light] = self.enclosed.reflected_in_view(light, self.faces)
        return tuple(one[view.where] for one in self.reflections[light])

    def _unshadowed(self, light: str, view: View) -> np.ndarray:
        """V of a rendered light without shadows, at the size at which glow is rendered."""
        eye, camera, small = self.scene.camera.position, self.scene.camera, self._small_camera()
        one, tolerance = self.scene.lights[light], self.fineness.glow_tolerance
        if not one.smooth or (small.width, small.height) == (camera.width, camera.height):
            return self._own(one.glow(self.medium, eye, view.directions, view.depth, tolerance))
        if light not in self.glows:
            depth = self._solid_depth(small.width, small.height, view)
            self.glows[light] = self._own(one.glow(self.medium, eye, small.directions(small.pixel_centres()), depth, tolerance))
        return self._resampled(self.glows[light], view)

    def _unshadowed_share(self, light: str, view: View) -> np.ndarray:
        """What shadows leave of the light's V, from two renders whose sampling errors cancel."""
        shaded, unshaded = (self._resampled(image, view) for image in self._with_and_without_shadows(light)[:2])
        known = unshaded > LEAST_UNSHADED * max(float(unshaded.max()), 1e-300)
        return np.where(known, np.clip(shaded / np.where(known, unshaded, 1.0), 0, 1), 1.0)

    def _has_shadows(self, light: str) -> bool:
        return f"{SHADOWS}_{light}" in self.runs or f"{SHADED}_{light}" in self.runs

    def _with_and_without_shadows(self, light: str) -> tuple[np.ndarray, np.ndarray, float]:
        """The small renders (h, w, 3) of the light's V with and without shadows, and their exposure."""
        both = f"{SHADOWS}_{light}"
        if both in self.runs:
            image = self._image(both)
            return image[..., :1], image[..., 1:2], self.runs[both].exposure
        shaded, unshaded = (self._image(f"{kind}_{light}") for kind in (SHADED, UNSHADED))
        return shaded, unshaded, self.runs[f"{SHADED}_{light}"].exposure

    def _enlarged(self, run: str, view: View) -> np.ndarray:
        return self._resampled(self._image(run), view)

    def _resampled(self, values: np.ndarray, view: View) -> np.ndarray:
        """What was rendered at any size, at the view's pixels."""
        if values.shape[:2] != self.depth.shape:
            key = values.shape[:2], view is self.behind
            if key not in self.enlargements:
                coarse_depth = self._solid_depth(values.shape[1], values.shape[0], view)
                self.enlargements[key] = Enlargement(coarse_depth, view.full_depth)
            values = self.enlargements[key].of(values)
        return values[view.where]

    def _solid_depth(self, width: int, height: int, view: View) -> np.ndarray:
        """Depth [m] of what the renders of this size saw; where that is nothing, the view's farthest."""
        if (width, height) not in self.solid_depths:
            camera = self.scene.camera.resized(width, height)
            self.solid_depths[width, height] = visible(camera, self.scene.shapes, self.scene.lights)[0]
        depth = self.solid_depths[width, height]
        return np.where(np.isfinite(depth), depth, float(view.full_depth.max()))

    def _transmittance(self, lights: list[str], view: View) -> np.ndarray:
        eye = np.exp(-view.optical_depth)
        radiance = None
        if any(map(self.enclosed.reflects, lights)):
            radiance = np.maximum(read_map(self.build.photograph, self.depth.shape)[view.where].astype(float), 0)
        together = combined_transmittance(eye, (self._arriving(light, eye, view) for light in lights), radiance)
        return np.where(self.without_surface[view.where][..., None], eye, together)

    def _arriving(self, light: str, eye: np.ndarray, view: View) -> tuple[np.ndarray, ...]:
        """The light's strength, and irradiance/pi (..., 3) at unit strength: direct, without fog and with it on both
        ways, and the same of what arrives by reflection."""
        one, strength = self.scene.lights[light], self.strengths[light]
        if self.enclosed.reflects(light):
            clear, foggy = self._reflected(light, view)
            return strength, clear, foggy * eye, clear, foggy * eye
        if not self.scene.rendered(light):
            irradiance, on_the_way = one.arrival(self.medium, view.points, view.normals)
            clear = irradiance[..., None] / np.pi
            reduced = clear * eye * self._own(on_the_way)
            return strength, clear, reduced, clear, reduced
        irradiance, path = one.incident(view.points)
        rendered = f"transmittance_{light}" in self.runs
        if self.fineness.transmittance != fineness.MIDPOINT and one.integrates(self.medium):
            # by a render it is known better, but where nothing of the light arrives directly
            on_the_way = self._way(light, view)
        elif one.midpoint() is not None:
            on_the_way = self._through(self.medium.density_path(one.midpoint(), view.points))
        else:
            # light that comes by reflection crosses fog about as dense as what lies before the eye
            length = np.linalg.norm(view.points - self.scene.camera.position, axis=-1)
            mean = self.medium.density_path(self.scene.camera.position, view.points) / np.maximum(length, 1e-12)
            on_the_way = self._through(mean * path)
        indirect = irradiance[..., None] / np.pi
        basis, exposure = self._clear(light)
        basis = basis[view.where]
        clear, entry = basis / exposure, self._entry(one, view, basis)
        if not rendered or not self._is_full_size(f"transmittance_{light}"):
            if rendered:
                on_the_way = np.clip(on_the_way * self._rendered_off(light, view), 0, 1)
            both_ways = eye * on_the_way
            return strength, clear, clear * both_ways * entry, indirect, indirect * both_ways
        fogged = self._image(f"transmittance_{light}")[view.where]
        reduced = np.minimum(fogged / self.runs[f"transmittance_{light}"].exposure, clear) * entry
        digits = (fogged > FEWEST_DIGITS) & (basis > FEWEST_DIGITS)
        off_middle = self._off_middle(reduced, clear * eye * on_the_way, digits, view)
        return (strength, clear, np.where(digits, reduced, clear * eye * on_the_way * off_middle), indirect,
                indirect * eye * on_the_way * off_middle)

    def _entry(self, light: Light, view: View, basis: np.ndarray) -> np.ndarray:
        """Transmittance (..., 3) on the way before the one that renders count, where anything arrives."""
        lit = basis.any(-1)
        path = np.zeros(lit.shape)
        path[lit] = light.entry_path(view.points[lit], self.medium)
        return self._through(path)

    def _rendered_off(self, light: str, view: View) -> np.ndarray:
        """By what renders smaller than the photograph say that fog dims the light differently (..., 3) than on its mean way:
        near 1, and not the way itself, which bends where surfaces meet."""
        if light not in self.rendered_offs:
            one, fogged, basis = self.scene.lights[light], self._image(f"transmittance_{light}"), self._image(f"clear_{light}")
            camera = self.scene.camera.resized(fogged.shape[1], fogged.shape[0])
            depth = self._solid_depth(camera.width, camera.height, view)
            points = camera.position + depth[..., None] * camera.directions(camera.pixel_centres())
            if one.integrates(self.medium):
                known = one.way_transmittance(self.medium, points, surface_normals(points, camera.position),
                                              self.fineness.transmittance_step)
            else:
                known = np.exp(-self.medium.optical_depth(one.midpoint(), points))
            digits = (fogged > FEWEST_DIGITS) & (basis > FEWEST_DIGITS)
            both = np.exp(-self.medium.optical_depth(camera.position, points)) * known
            ratio = fogged / self.runs[f"transmittance_{light}"].exposure * self.runs[f"clear_{light}"].exposure
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                ratio = np.where(digits & (both > 0), ratio / (basis * both), 1.0)
            pixel = depth / float(np.mean(camera.focal_length))
            self.rendered_offs[light] = carried(np.clip(ratio, 1 / MOST_OFF_MIDDLE, MOST_OFF_MIDDLE), digits.all(-1), points,
                                                pixel)
        return self._resampled(self.rendered_offs[light], view)

    def _is_full_size(self, run: str) -> bool:
        return (self.runs[run].height, self.runs[run].width) == self.depth.shape

    def _way(self, light: str, view: View) -> np.ndarray:
        """Transmittance (..., 3) of the light's way to the surfaces, by an integral over its area: as smooth as glow."""
        one, step, eye = self.scene.lights[light], self.fineness.transmittance_step, self.scene.camera.position
        if one.midpoint() is None:
            return self._own(one.way_transmittance(self.medium, view.points, view.normals, step))
        if light not in self.ways:
            camera = self._small_camera()
            directions = camera.directions(camera.pixel_centres())
            points = eye + self._solid_depth(camera.width, camera.height, view)[..., None] * directions
            self.ways[light] = self._own(one.way_transmittance(self.medium, points, surface_normals(points, eye), step))
        return self._resampled(self.ways[light], view)

    def _small_camera(self) -> Camera:
        """The camera at the size at which glow is found."""
        camera = self.scene.camera
        return camera.resized(*glow_size(camera.width, camera.height, self.fineness.in_scattering_size))

    def _off_middle(self, reduced, from_middle, digits, view: View) -> np.ndarray:
        """By what fog dims the light differently (..., 3) than on the way from its middle, carried on into penumbrae."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = np.where(digits & (from_middle > 0), reduced / from_middle, 1.0)
        ratio = np.clip(ratio, 1 / MOST_OFF_MIDDLE, MOST_OFF_MIDDLE)
        if view.where is not ...:
            return ratio
        focal_length = float(np.mean(self.scene.camera.focal_length))
        return carried(ratio, digits.all(-1), view.points, view.depth / focal_length)

    def _clear(self, light: str) -> tuple[np.ndarray, float]:
        """Irradiance/pi of the light without fog times an exposure, and that, of as many small lights as the render with
        fog has."""
        finer = f"clear_{light}"
        if finer in self.runs and self._is_full_size(finer):
            return _least_channels(self._image(finer)), self.runs[finer].exposure
        image = _least_channels(read_map(self.build.basis / f"irradiance_{light}.exr")).astype(float)
        return image, read_json(self.build.basis / "runs.json")[f"irradiance_{light}"]["exposure"]

    def _image(self, run: str) -> np.ndarray:
        return read_map(self.build.runs / f"{run}.exr").astype(float)


def _least_channels(image: np.ndarray) -> np.ndarray:
    """(H, W, 3), or (H, W, 1) where it is grey."""
    grey = all(np.array_equal(image[..., 0], image[..., k]) for k in (1, 2))
    return np.ascontiguousarray(image[..., :1]) if grey else image
