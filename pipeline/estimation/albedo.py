"""Albedo of the photographed surfaces: Retinex against rendered shading, and segments of one albedo.

Retinex (Land & McCann 1971; Grosse et al. 2009, "Ground truth dataset and baseline evaluations for
intrinsic image algorithms") calls a strong log-gradient of the photograph reflectance and a weak one
shading. Here the lights have been rendered, so more is known: with shading S = sum_l w_l B_l,

    grad log S = sum_l (w_l B_l / S) grad log B_l

is a convex combination of the lights' own log-gradients, whatever the unknown w_l >= 0. A gradient
outside the interval they span cannot be shading. The separation therefore needs no intensities, and
an error in them cannot feed back into the albedo.

Images are linear and scene-referred; logarithms are natural.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

DEFAULT_ALBEDO = 0.5
LOWEST_ALBEDO, HIGHEST_ALBEDO = 0.02, 0.98
# Log-gradients below these are sensor noise, interpolation or coarse geometry. Shading may change a
# channel's ratio to the others only where lights of different colour cross, which is gradual.
LIGHTNESS_THRESHOLD, CHROMA_THRESHOLD = 0.05, 0.04
# Two albedos of one face are told apart when their modes are this far apart in log, and the density
# between falls below this part of the lower mode. Bins are narrow against both; an even ramp has no
# valley, and the density is smoothed over two bins against those that chance makes.
LEAST_SEPARATION, DEEPEST_ONE_ALBEDO, BIN = 0.15, 0.25, 0.02


def log_reflectance(log_photograph, log_basis, surface, usable, log_shading, reach: int = 1) -> np.ndarray:
    """Logarithm of the reflectance that explains what no light can, (h, w, 3).

    log_photograph: (h, w, 3). log_basis: (L, h, w, 3), finite. surface: (h, w) face index, -1 none.
    usable: (h, w). log_shading: (h, w, 3), a first guess, which sets only the level of each connected
    piece of a face. reach [pixel]: how far the geometry may be displaced, so that a light's gradient
    explains the photograph's gradient from this far away. Unusable pixels hold the guess.
    """
    guess = log_photograph - log_shading
    # Without a pull the level of a piece is undetermined; with this one it is felt over 1000 pixels,
    # longer than any face, so that it does not bend the reflectance within a face.
    pull = 1e-6
    number = np.arange(usable.size).reshape(usable.shape)
    heads, tails, targets = [], [], []
    for axis in (0, 1):
        ahead, behind = _neighbours(axis)
        linked = usable[ahead] & usable[behind] & (surface[ahead] == surface[behind])
        target = _reflectance_gradient(log_photograph, log_basis, axis, reach)
        heads.append(number[ahead][linked])
        tails.append(number[behind][linked])
        targets.append(target[linked])
    head, tail, target = np.concatenate(heads), np.concatenate(tails), np.concatenate(targets)
    rows = np.arange(len(head))
    gradient = sparse.csr_matrix((np.ones(len(head)), (rows, head)), (len(head), usable.size)) \
        - sparse.csr_matrix((np.ones(len(tail)), (rows, tail)), (len(tail), usable.size))
    normal = (gradient.T @ gradient + pull * sparse.identity(usable.size)).tocsc()
    right = gradient.T @ target + pull * guess.reshape(-1, 3)
    solved = splu(normal, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(right)
    return solved.reshape(guess.shape)


def _neighbours(axis: int):
    """Index pairs of the pixels after and before each edge along `axis`."""
    return (np.s_[1:], np.s_[:-1]) if axis == 0 else (np.s_[:, 1:], np.s_[:, :-1])


def _reflectance_gradient(log_photograph, log_basis, axis: int, reach: int) -> np.ndarray:
    """Part of the photograph's log-gradient along `axis` that reflectance must explain."""
    seen = np.diff(log_photograph, axis=axis)
    of_lights = np.diff(log_basis, axis=axis + 1).mean(-1)
    size = 2 * reach + 1
    lowest = ndimage.minimum_filter(of_lights.min(0), size, mode="nearest")
    highest = ndimage.maximum_filter(of_lights.max(0), size, mode="nearest")
    lightness = seen.mean(-1)
    excess = lightness - np.clip(lightness, np.minimum(lowest, 0), np.maximum(highest, 0))
    excess[np.abs(excess) < LIGHTNESS_THRESHOLD] = 0
    chroma = seen - lightness[..., None]
    chroma[np.abs(chroma).max(-1) < CHROMA_THRESHOLD] = 0
    return excess[..., None] + chroma


def albedo_segments(reflectance, surface, usable, most_per_face: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Segments of one albedo: each face, halved while its log reflectance is plainly bimodal.

    reflectance: (h, w, 3), log. Returns (segment, face_of_segment): (h, w) int32 with -1 at unusable
    pixels, and (S,) the face that each segment lies on. A smooth ramp is never cut, because that
    would hand the shading of a wall to its albedo.
    """
    segment = np.full(surface.shape, -1, np.int32)
    faces = []
    for face in np.unique(surface[usable & (surface >= 0)]):
        pieces = [np.flatnonzero((usable & (surface == face)).ravel())]
        least = max(30, 0.01 * len(pieces[0]))
        whole = []
        while pieces:
            piece = pieces.pop(0)
            room_left = len(pieces) + len(whole) + 2 <= most_per_face
            halves = _two_albedos(reflectance.reshape(-1, 3)[piece], least) if room_left else None
            if halves is not None:
                pieces += [piece[halves], piece[~halves]]
            else:
                whole.append(piece)
        for piece in whole:
            segment.ravel()[piece] = len(faces)
            faces.append(face)
    return segment, np.array(faces, np.int32)


def _two_albedos(values: np.ndarray, least: float) -> np.ndarray | None:
    """Which of (n, 3) log reflectances lie above the deepest valley of their density; None without one.

    At least `least` values stay on either side.
    """
    spread = values - values.mean(0)
    along = spread @ np.linalg.svd(spread.T @ spread)[0][:, 0]
    edges = np.arange(along.min() - 3 * BIN, along.max() + 4 * BIN, BIN)
    counts = np.histogram(along, edges)[0]
    density = ndimage.gaussian_filter1d(counts.astype(float), 2, mode="constant")
    flanks = np.minimum(np.maximum.accumulate(density), np.maximum.accumulate(density[::-1])[::-1])
    below = np.cumsum(counts)
    possible = (below >= least) & (len(values) - below >= least)
    depth = np.where(possible, density / np.maximum(flanks, 1e-9), 1)
    valley = int(depth.argmin())
    apart = (valley + density[valley:].argmax() - density[: valley + 1].argmax()) * BIN
    if depth[valley] > DEEPEST_ONE_ALBEDO or apart < LEAST_SEPARATION:
        return None
    return along > edges[valley + 1]


def mean_albedo_per_surface(
    segment_albedo, face_of_segment, pixels_of_segment, surface
) -> dict[int, np.ndarray]:
    """Mean albedo (3,) of every face in `surface`, the input of the next interreflection render.

    segment_albedo: (S, 3); face_of_segment, pixels_of_segment: (S,). A face of which no pixel was
    usable takes the mean of the whole photograph, or the default when there is nothing at all.
    """
    weight = np.asarray(pixels_of_segment, float)
    if weight.sum() > 0:
        overall = weight @ segment_albedo / weight.sum()
    else:
        overall = np.full(3, DEFAULT_ALBEDO)
    means = {}
    for face in np.unique(surface[surface >= 0]).tolist():
        share = np.where(np.asarray(face_of_segment) == face, weight, 0)
        means[face] = share @ segment_albedo / share.sum() if share.sum() > 0 else overall
    return means
