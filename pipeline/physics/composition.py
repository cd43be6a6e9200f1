"""The paper's decomposition: transmittance of several lights together, and C = R * T + V."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

#: Share of a light that counts as indirect where nothing says how much there is: enough to keep T
#: finite and continuous in full shadow, too little to be seen where a light arrives directly.
INDIRECT_SHARE = 1e-3
#: Linear; 8-bit code 217. What JPEG rings around a burnt-out edge stays above it.
NEAR_WHITE = 0.7


def combined_transmittance(eye: np.ndarray, arriving: Iterable[tuple[np.ndarray, ...]], radiance: np.ndarray | None = None
                           ) -> np.ndarray:
    """Share of the photograph's radiance that survives from the lights by way of the surface to the eye.

    T = sum_l w_l T_l, w_l light l's share of the reflected radiance (Zhao et al. 2013, eq. 5, for
    several lights; the paper's midpoint is replaced by what the renders integrated over the lamp).
    eye: (H, W, 3) transmittance from surface to eye. arriving, of each light, one at a time, for they may be many:
    strength (3,); clear, reduced (H, W, 3) irradiance/pi without and with fog on both ways; indirect,
    indirect_reduced (H, W, 3) the same of light that arrives by reflection, roughly. Where no light reaches a pixel
    at all, T is `eye`.

    More light may reach a surface through fog than did without, for the fog scatters it into shadows: of radiance (H, W, 3),
    which the photograph shows, no more grows than a white surface would throw back. The rest shines itself.
    """
    above, below = np.zeros((*eye.shape[:-1], 3)), np.zeros((*eye.shape[:-1], 3))
    for strength, clear, reduced, indirect, indirect_reduced in arriving:
        below += strength * (clear + INDIRECT_SHARE * indirect)
        above += strength * (reduced + INDIRECT_SHARE * indirect_reduced)
    with np.errstate(divide="ignore", invalid="ignore"):
        together = above / below
        if radiance is not None:
            thrown_back = np.minimum(1, below / np.maximum(radiance, 1e-12))
            together = np.where(together > eye, eye + (together - eye) * thrown_back, together)
    return np.where(below > 0, np.clip(together, 0, 1), eye)


def composite(radiance: np.ndarray, transmittance: np.ndarray, in_scattering: np.ndarray) -> np.ndarray:
    """Foggy radiance C = R * T + V, linear, scene-referred (Zhao et al. 2013, section 4)."""
    return radiance * transmittance + in_scattering


def with_restored_lamps(radiance: np.ndarray, clipped: np.ndarray, emitter: np.ndarray,
                        strengths: dict[int, np.ndarray]) -> np.ndarray:
    """The photograph with the estimated radiance where it shows a lamp burnt out, (H, W, 3).

    A clipped pixel is as bright as white; dimmed by fog it would turn into a grey hole in the middle of its
    own glow. clipped: (H, W). emitter: (H, W) index of the light seen, -1 none. strengths: radiance (3,) by
    index. A lamp is restored where it is mostly clipped; what else is near white in it is JPEG's ringing.
    """
    return restored(np.array(radiance, float), clipped, emitter, burnt_out(clipped, emitter, strengths))


def burnt_out(clipped: np.ndarray, emitter: np.ndarray, strengths: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Those of the lamps, seen where `emitter` (H, W) is their index, that are mostly `clipped` (H, W)."""
    return {index: strength for index, strength in strengths.items()
            if (lamp := emitter == index).any() and clipped[lamp].mean() > 0.5}


def restored(radiance: np.ndarray, clipped: np.ndarray, emitter: np.ndarray, strengths: dict[int, np.ndarray]
             ) -> np.ndarray:
    """`radiance` (H, W, 3), of which burnt-out lamps take their strength, in place."""
    if not strengths:
        return radiance
    near_white = clipped | (radiance.min(-1) > NEAR_WHITE)
    for index, strength in strengths.items():
        shown = (emitter == index) & near_white
        radiance[shown] = np.maximum(radiance[shown], strength)
    return radiance
