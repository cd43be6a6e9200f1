"""T and V of some pixels of the Cornell room by quadrature, and how far a map is off there."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from pipeline.imaging.atomic import replacing
from tests.reference import quadrature as q
from tests.validation.truth import ROOM, Fog

SIZE, PIXELS = 480, 1500
#: The default fog of scenes/cornell.
FOG = Fog(0.05, 0.1)


class Truth:
    """Random pixels of the room in FOG, worked out once and kept in `folder`.

    chosen (n,): their places row by row; eye (n, 3): transmittance from surface to eye; T and V (n, 3), T NaN where no
    light arrives directly or a lamp is seen, V where a lamp is seen.
    """

    def __init__(self, folder: Path):
        source = Path(q.__file__).read_bytes() + Path(__file__).read_bytes()
        path = folder / f"truth_{hashlib.sha256(source).hexdigest()[:12]}.npz"
        if not path.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            with replacing(path) as name, open(name, "wb") as file:
                np.savez(file, **worked_out())
        with np.load(path) as stored:
            self.chosen, self.eye, self.maps = stored["chosen"], stored["eye"], {name: stored[name] for name in "TV"}

    def errors(self, name: str, found: np.ndarray, without_eye: bool = False) -> dict[str, float]:
        """Of a map (SIZE, SIZE, 3), as `errors` counts them; without_eye: it lacks the way from surface to eye."""
        values = found.reshape(-1, 3)[self.chosen].astype(float)
        return errors(values * self.eye if without_eye else values, self.maps[name])


def worked_out() -> dict[str, np.ndarray]:
    rays = ROOM.rays(SIZE, SIZE)
    chosen = np.sort(np.random.default_rng(1).permutation(SIZE * SIZE)[:PIXELS])
    some = q.Rays(rays.origin, rays.directions[chosen], rays.depth[chosen], rays.normals[chosen], rays.emitter[chosen])
    occluders = ROOM.polygons[:ROOM.lamp_polygon]
    lamp = some.emitter[:, None]
    return {"chosen": chosen, "eye": np.exp(-FOG.medium.extinction * some.depth[:, None]),
            "T": np.where(lamp, np.nan, q.transmittance(some, FOG.medium, [ROOM.lamp], occluders)),
            "V": np.where(lamp, np.nan, q.in_scattering(some, FOG.medium, ROOM.lamp, occluders))}


def errors(found: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """Of pixels (n, 3): median of the relative error, of the worst channel each; and root mean square of the difference
    over that of the truth. Pixels whose truth is NaN or 0 are left out; one that is not found counts as 0."""
    known = (np.nan_to_num(true) > 0).all(1)
    found, true = np.nan_to_num(found[known]), true[known]
    return {"median": float(np.median(np.abs(found / true - 1).max(1))),
            "rms": float(np.sqrt(((found - true) ** 2).mean() / (true**2).mean()))}
