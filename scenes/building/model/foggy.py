"""Render the street with fog in it: what the composite is held against by eye.

    python scenes/building/model/foggy.py [FOG ...]

writes truth/FOG.exr; ten minutes for the clear street, then some minutes a fog. Surfaces and their distance are those of
the model, leaf by leaf, three times finer than the picture, and so is the shade of houses and trees in the fog. Sun and
sky have crossed the fog when they arrive, as in the scene: what is scattered more than once is in the sky's light.
Where a house hides the sky it throws back what houses do in the picture, and from below comes what the ground does.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import cv2
import numpy as np

MODEL = Path(__file__).resolve().parent
SCENE = MODEL.parent
sys.path[:0] = [str(SCENE.parents[1]), str(SCENE.parent), str(MODEL)]  # so that the script runs from anywhere, uninstalled

import in_fog  # noqa: E402
import modelled  # noqa: E402
from pipeline.imaging.maps import read_map  # noqa: E402
from render import HEIGHT, SUPERSAMPLING, WIDTH, camera, truth  # noqa: E402

#: [m] How far the scene takes its sky to be, and how far away nothing solid is any more.
SKY, REACH = 2000.0, 120.0
SKY_LIGHTS, SKY_SHRUNK = 64, 2
GROUND, HOUSES = 1, (2, 3, 4)


class Street:
    """The clear street, finer than the picture by SUPERSAMPLING: radiance (h, w, 3), distance (h, w) [m], SKY for the sky."""

    def __init__(self):
        fine = SUPERSAMPLING * WIDTH, SUPERSAMPLING * HEIGHT
        model = MODEL / "building.pov"
        self.radiance = modelled.rendered(model, *fine)
        self.distance = distance_of(modelled.rendered(model, *fine, Layer=1))
        self.numbers = modelled.numbers(MODEL / "numbers.inc")
        things = np.round(modelled.rendered(model, WIDTH, HEIGHT, Layer=2)[..., 0]).astype(int)
        photograph = read_map(SCENE / "photograph.exr")
        self.ground = photograph[things == GROUND].mean(0)
        self.houses = photograph[np.isin(things, HOUSES)].mean(0)

    def foggy(self, fog: in_fog.Fog) -> np.ndarray:
        """(HEIGHT, WIDTH, 3) [photo unit]."""
        kappa, delta = float(np.mean(fog.extinction)), float(np.mean(fog.scattering))
        declared = {"Scattering": delta, "Extinction": kappa, "Asymmetry": fog.asymmetry, "Reach": REACH}
        sun = scattered(WIDTH, HEIGHT, kappa, **declared)
        sky = scattered(WIDTH // SKY_SHRUNK, HEIGHT // SKY_SHRUNK, kappa, Sky_Lights=SKY_LIGHTS, Fog_Samples=24, **declared)
        view = camera(self.numbers).directions
        size = self.distance.shape
        to_eye = -directions(view, *size)
        # towards the eye of light from above and below, each of radiance 1
        above, below, listed = halves(to_eye, fog.asymmetry)
        open_sky = above / listed * enlarged(*sky, self.distance)
        albedo = delta / kappa
        sky_light, sun_light = self.numbers["Sky_Radiance"], self.numbers["Sun_Irradiance"]
        uniform = albedo * (above[..., None] * self.houses + below[..., None] * self.ground)
        source = uniform + open_sky[..., None] * (sky_light - self.houses) + enlarged(*sun, self.distance)[..., None] * sun_light
        # beyond the ball nothing stands in the light's way
        travel = np.array(truth(self.numbers)["sun"]["direction"])
        free = albedo * (above[..., None] * sky_light + below[..., None] * self.ground
                         + phase(to_eye @ travel, fog.asymmetry)[..., None] * sun_light)
        near = np.exp(-kappa * np.minimum(self.distance, REACH))[..., None]
        whole = np.exp(-kappa * self.distance)[..., None]
        picture = self.radiance * whole + source * (1 - near) + free * (near - whole)
        return picture.reshape(HEIGHT, SUPERSAMPLING, WIDTH, SUPERSAMPLING, 3).mean((1, 3))


def distance_of(inverse: np.ndarray) -> np.ndarray:
    inverse = inverse[..., 0]
    return np.where(inverse > 0, 1 / np.maximum(inverse, 1e-6), SKY)


def directions(view, height: int, width: int) -> np.ndarray:
    """Unit vectors (height, width, 3) from the eye through a picture of another size."""
    rows, columns = np.mgrid[:height, :width] + 0.5
    return view(np.stack([columns * WIDTH / width, rows * HEIGHT / height], -1))


def phase(cosine: np.ndarray, asymmetry: float) -> np.ndarray:
    """Henyey-Greenstein [1/sr]; the cosine is 1 for light that goes straight on."""
    g = asymmetry
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def spiral(count: int) -> np.ndarray:
    """Directions (count, 3) of the upper hemisphere, as in foggy.pov."""
    index = np.arange(count)
    up, turn = (index + 0.5) / count, index * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - up**2)
    return np.stack([across * np.cos(turn), up, across * np.sin(turn)], -1)


def halves(to_eye: np.ndarray, asymmetry: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integral of the phase function over light from above, from below, and from above by SKY_LIGHTS directions.

    They depend on how steep the ray is, and the last one on its turn too; the first is by many more directions.
    """
    height, width = to_eye.shape[:2]
    small = cv2.resize(to_eye, (width // 12, height // 12), interpolation=cv2.INTER_AREA)
    small /= np.linalg.norm(small, axis=-1, keepdims=True)

    def total(count: int) -> np.ndarray:
        return sum(phase(small @ -towards, asymmetry) for towards in spiral(count)) * (2 * np.pi / count)

    above, listed = (cv2.resize(total(count), (width, height), interpolation=cv2.INTER_CUBIC) for count in (4096, SKY_LIGHTS))
    return above, 1 - above, listed


def scattered(width: int, height: int, kappa: float, **declared: float) -> tuple[np.ndarray, np.ndarray]:
    """V of a light of unit strength over the share of light that the fog before each pixel takes, and its distance [m]."""
    distance = distance_of(modelled.rendered(MODEL / "building.pov", width, height, Layer=1))
    v = modelled.rendered(MODEL / "foggy.pov", width, height, **declared)[..., 0]
    return v / -np.expm1(-kappa * np.minimum(distance, REACH)), distance


def enlarged(values: np.ndarray, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Values (h, w) at distances `coarse` (h, w), at finer pixels of distances `fine` (H, W): of neighbours as far away."""
    height, width = fine.shape
    rows = (np.arange(height) + 0.5) * values.shape[0] / height - 0.5
    columns = (np.arange(width) + 0.5) * values.shape[1] / width - 0.5
    total, weights = np.zeros(fine.shape), np.zeros(fine.shape)
    for i in (-1, 0, 1, 2):
        for j in (-1, 0, 1, 2):
            at, to = np.floor(rows).astype(int) + i, np.floor(columns).astype(int) + j
            near = np.maximum(2 - np.abs(rows - at), 0)[:, None] * np.maximum(2 - np.abs(columns - to), 0)
            place = np.ix_(np.clip(at, 0, len(values) - 1), np.clip(to, 0, values.shape[1] - 1))
            apart = np.log(coarse[place] / fine)
            weight = near * (np.exp(-0.5 * (apart / 0.05) ** 2) + 1e-6)
            total += weight * values[place]
            weights += weight
    return total / weights


if __name__ == "__main__":
    fogs = in_fog.asked(__doc__, SCENE)
    street = Street()
    for one in fogs:
        start = time.monotonic()
        path = in_fog.write_truth(SCENE, one, street.foggy(one), "the model's surfaces and shades, sun and sky as they arrive")
        print(f"{path}: {time.monotonic() - start:.0f} s", flush=True)
