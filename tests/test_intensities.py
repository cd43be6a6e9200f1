"""Intensities of interior lights: a synthetic photograph with known light goes in, the light comes out.

The room is a box of 4 x 2.7 x 5 m seen from inside, with a cupboard that casts shadows; direct light is
summed over sub-lights with exact shadow rays, and interreflection is a constant per light.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import ndimage

from pipeline.errors import InputError
from pipeline.estimation.intensities import EstimationMaps, estimate_intensities, reduce_for_estimation

ROOM = np.array([4.0, 2.7, 5.0])
CUPBOARD = np.array([[0.4, 0.0, 1.0], [1.3, 1.2, 2.0]])
EYE = np.array([2.3, 1.5, 4.8])
# Floor, ceiling, left, right, back, front of the room, then the cupboard's six sides.
PAINT = np.array(
    [[0.35, 0.25, 0.18], [0.85, 0.85, 0.83], [0.6, 0.5, 0.4], [0.45, 0.5, 0.6], [0.7, 0.68, 0.62]]
    + [[0.5, 0.5, 0.5]]
    + [[0.3, 0.2, 0.12]] * 6
)
INDIRECT = 0.35  # share of the mean direct light that returns as a constant
# Corner, two edges [m], direction of emission: a ceiling lamp, a window on the right, a lamp at the back.
LIGHTS = {
    "ceiling lamp": ([1.8, 2.65, 2.8], [0.5, 0, 0], [0, 0, 0.5], [0, -1, 0]),
    "window": ([3.98, 0.9, 1.2], [0, 1.1, 0], [0, 0, 1.4], [-1, 0, 0]),
    "wall lamp": ([0.3, 1.7, 0.05], [0.3, 0, 0], [0, 0.3, 0], [0, 0, 1]),
    "spot": ([2.9, 2.6, 0.8], [0.1, 0, 0], [0, 0, 0.1], [0, -1, 0]),
    "lamp 5 cm beside": ([1.85, 2.65, 2.8], [0.5, 0, 0], [0, 0, 0.5], [0, -1, 0]),
}
FOUR = list(LIGHTS)[:4]
INTENSITY = np.array([[9.0, 7.5, 5.5], [1.0, 1.2, 1.5], [6.0, 4.5, 3.0], [40.0, 38.0, 34.0], [6.0, 5.0, 4.0]])


@dataclass
class Room:
    maps: EstimationMaps
    direct: np.ndarray  # (L, H, W, 3)
    truth: np.ndarray  # (L, 3)
    albedo: np.ndarray  # (H, W, 3)
    points: np.ndarray  # (H, W, 3) [m]
    names: tuple


def _hit_box(origin, direction, low, high, inside):
    """Distance, axis and sign of the face hit, along rays (..., 3); inside: the ray starts in the box."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - origin) / direction, (high - origin) / direction
    near, far = np.minimum(one, other), np.maximum(one, other)
    if inside:
        axis = far.argmin(-1)
        distance = far.min(-1)
    else:
        axis = near.argmax(-1)
        distance = np.where(near.max(-1) < far.min(-1), near.max(-1), np.inf)
        distance = np.where(distance > 1e-4, distance, np.inf)
    return distance, axis, np.take_along_axis(np.sign(direction), axis[..., None], -1)[..., 0]


def _room(names, height=120, width=160, seed=0, side=3):
    u, v = np.meshgrid((np.arange(width) + 0.5) / width * 2 - 1, (np.arange(height) + 0.5) / height * 2 - 1)
    rays = np.stack([u * 0.85, -v * 0.85 * height / width, -np.ones_like(u)], -1)
    distance, axis, sign = _hit_box(EYE, rays, np.zeros(3), ROOM, True)
    surface = np.select([axis == 1, axis == 0, axis == 2], [(sign > 0) * 1, 2 + (sign > 0), 4 + (sign > 0)])
    normal = -np.eye(3)[axis] * sign[..., None]
    block, block_axis, block_sign = _hit_box(EYE, rays, *CUPBOARD, False)
    front = block < distance
    surface = np.where(front, 6 + block_axis * 2 + (block_sign > 0), surface)
    normal = np.where(front[..., None], -np.eye(3)[block_axis] * block_sign[..., None], normal)
    points = EYE + rays * np.minimum(distance, block)[..., None]

    emitter = np.full(surface.shape, -1, np.int32)
    direct = np.zeros((len(names), height, width))
    for light, name in enumerate(names):
        corner, one, other, towards = (np.array(x, float) for x in LIGHTS[name])
        area = np.linalg.norm(np.cross(one, other))
        for s in (np.arange(side) + 0.5) / side:
            for t in (np.arange(side) + 0.5) / side:
                to_light = corner + s * one + t * other - points
                squared = (to_light**2).sum(-1)
                facing = (normal * to_light).sum(-1).clip(0) * (-(to_light @ towards)).clip(0)
                lit = _hit_box(points + 1e-3 * normal, to_light, *CUPBOARD, False)[0] > 1
                direct[light] += lit * facing / squared**2 * area / side**2 / np.pi
        local = np.stack([(points - corner) @ e / (e @ e) for e in (one, other)], -1)
        on_lamp = (local > 0).all(-1) & (local < 1).all(-1) & (np.abs((points - corner) @ towards) < 0.06)
        emitter[on_lamp & ~front] = light
    direct = np.repeat(direct[..., None], 3, -1)
    basis = direct + INDIRECT * direct.mean((1, 2), keepdims=True)
    albedo = PAINT[surface]
    truth = INTENSITY[[list(LIGHTS).index(name) for name in names]]
    truth = truth * 0.35 / (albedo * np.einsum("lhwc,lc->hwc", basis, truth)).mean()
    photograph = albedo * np.einsum("lhwc,lc->hwc", basis, truth)
    for light in range(len(names)):
        photograph[emitter == light] = truth[light]
    maps = EstimationMaps(photograph, basis, surface.astype(np.int32), emitter, photograph.max(-1) > 1e9)
    return Room(maps, direct, truth, albedo, points, tuple(names))


def _with_albedo(room, albedo):
    photograph = albedo * np.einsum("lhwc,lc->hwc", room.maps.basis, room.truth)
    photograph[room.maps.emitter >= 0] = room.maps.photograph[room.maps.emitter >= 0]
    return replace(room, maps=replace(room.maps, photograph=photograph), albedo=albedo)


def _patch(room, face=4):
    """A 40 cm patch of the back wall, annotated with its true mean albedo."""
    mask = (room.maps.surface == face) & (np.abs(room.points[..., 0] - 2.6) < 0.2)
    mask &= np.abs(room.points[..., 1] - 1.4) < 0.2
    return mask, room.albedo[mask].mean(0)


def _annotated(room):
    return replace(room, maps=replace(room.maps, annotated=(_patch(room),)))


def _tiles(room):
    """The room with 30 cm tiles, 3 cm grout, and brightness that varies from tile to tile."""
    rng = np.random.default_rng(3)
    cell = np.floor(room.points / 0.3 + 1e-6).astype(int)
    offset = room.points / 0.3 - cell
    tone = rng.normal(1, 0.08, (32, 32, 32))[tuple(np.moveaxis(cell % 32, -1, 0))]
    axis = np.array([1, 1, 0, 0, 2, 2] + [0, 0, 1, 1, 2, 2])[room.maps.surface]
    along = np.arange(3) != axis[..., None]
    grout = ((offset < 0.1) & along).any(-1)
    tiled = np.isin(room.maps.surface, (0, 2, 4))
    factor = np.where(tiled, np.where(grout, 0.5, tone), 1)
    return _with_albedo(room, room.albedo * factor[..., None])


def _developed(room, seed=5):
    """The photograph as a camera gives it: objects the geometry lacks, clipping, 8-bit sRGB."""
    rng = np.random.default_rng(seed)
    photograph = room.maps.photograph.copy()
    height, width = photograph.shape[:2]
    y, x = np.mgrid[:height, :width]
    for _ in range(8):  # eight discs of 0.6 % of the frame each: 5 %
        radius = np.sqrt(0.006 * height * width / np.pi)
        disc = (x - rng.uniform(0, width)) ** 2 + (y - rng.uniform(0, height)) ** 2 < radius**2
        for mask, _ in room.maps.annotated:  # a person annotates what they see, not what is hidden
            disc &= ~mask
        photograph[disc] = rng.uniform(0.03, 0.9, 3) * rng.uniform(0.3, 1, (disc.sum(), 1))
    encoded = np.where(
        photograph < 0.0031308, 12.92 * photograph, 1.055 * np.maximum(photograph, 1e-9) ** (1 / 2.4) - 0.055
    )
    encoded = np.round(encoded.clip(0, 1) * 255) / 255
    linear = np.where(encoded < 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return replace(room, maps=replace(room.maps, photograph=linear, clipped=(encoded >= 0.996).any(-1)))


def _wrong_geometry(room, indirect_factor):
    """The basis that a coarse model renders: shadows displaced by 3 pixels in 480, indirect light off."""
    scale = round(3 * room.maps.surface.shape[1] / 480)
    direct = room.direct.copy()
    direct[0] = np.roll(direct[0], scale, axis=1)
    basis = direct + indirect_factor * INDIRECT * direct.mean((1, 2), keepdims=True)
    return replace(room, maps=replace(room.maps, basis=basis))


def _worst(fit, room):
    return np.abs(fit.intensity / room.truth - 1).max()


def _fit(room, **known):
    return estimate_intensities(room.maps, room.names, **known)


def _assert_sane(fit):
    for values in (fit.intensity, fit.albedo, fit.segment_albedo, fit.correlation, fit.condition_number):
        assert np.isfinite(values).all()
    assert not np.isnan(fit.standard_error).any() and (fit.standard_error >= 0).all()
    assert (fit.intensity >= 0).all()
    assert fit.albedo.min() >= 0.02 and fit.albedo.max() <= 0.98
    assert np.isfinite([fit.residual_median, fit.residual_p90]).all()


@pytest.fixture(scope="module")
def room():
    return _room(FOUR)


@pytest.fixture(scope="module")
def large_room():
    return _room(FOUR, height=360, width=480, side=2)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_exact_basis_gives_the_intensities(count):
    exact = _annotated(_room(FOUR[:count], height=90, width=120))
    fit = _fit(exact)
    # The prior of every surface pulls 0.3 %; the rest of the 2 % is room for other platforms' solvers.
    assert _worst(fit, exact) < 0.02
    assert fit.residual_median < 1e-3
    assert fit.scale_source == "annotated albedo"
    assert fit.inseparable == ()
    _assert_sane(fit)


def test_tiles_do_not_bias_the_intensities(room):
    tiled = _annotated(_tiles(room))
    # 30 cm tiles that vary by 8 %: a few dozen on the wall a light falls on average to about 1 %.
    assert _worst(_fit(tiled), tiled) < 0.03


@pytest.mark.parametrize("indirect_factor", [0.85, 1.15])
def test_photograph_like_input(large_room, indirect_factor):
    """Tiles, clipping, 8 bits, 5 % foreign objects, a shadow 3 pixels off, interreflection 15 % off."""
    hard = _wrong_geometry(_developed(_annotated(_tiles(large_room))), indirect_factor)
    fit = _fit(hard)
    errors = np.abs(fit.intensity / hard.truth - 1)
    # Half the light in the shade is interreflection, so that 15 % of it is worth some 8 % of a light;
    # the wall lamp, seen mostly through its own interreflection, takes the whole of it.
    assert np.median(errors) < 0.08
    assert errors.max() < 0.18
    # The stated error covers the truth at three sigma, although the model is wrong.
    assert (np.abs(fit.intensity - hard.truth) < 3.5 * fit.standard_error).all()
    _assert_sane(fit)


def test_basis_without_interreflection_reads_it_as_intensity(room):
    """Why the basis must hold interreflection: without it the lights come out too bright."""
    exact = _annotated(room)
    direct_only = replace(exact, maps=replace(exact.maps, basis=exact.direct + 1e-4 * exact.maps.basis))
    assert (_fit(direct_only).intensity.sum(0) > 1.1 * exact.truth.sum(0)).all()


def test_loop_of_solve_and_render_converges(room):
    """Interreflection proportional to rho/(1 - rho) with the mean albedo of the last solve."""
    exact = _annotated(room)

    def rendered(mean_albedo):
        gain = mean_albedo / (1 - mean_albedo) * (1 - true_mean) / true_mean * INDIRECT
        return exact.direct + gain * exact.direct.mean((1, 2), keepdims=True)

    surfaces, counts = np.unique(exact.maps.surface, return_counts=True)
    true_mean = counts @ PAINT[surfaces] / counts.sum()
    mean, start = np.full(3, 0.35), None
    for _ in range(5):
        fit = _fit(replace(exact, maps=replace(exact.maps, basis=rendered(mean))), start=start)
        start = fit.intensity
        mean = counts @ np.array([fit.surface_albedo[s] for s in surfaces.tolist()]) / counts.sum()
    assert _worst(fit, exact) < 0.03  # the 2 % of an exact basis, and 1 % left of the loop
    assert np.abs(mean / true_mean - 1).max() < 0.03


def test_default_scale_is_stated_and_ratios_hold(room):
    fit = _fit(room)
    assert fit.scale_source == "default albedo 0.5"
    assert any("mean albedo was taken as 0.5" in message for message in fit.messages)
    # Area-weighted mean over the pixels that the fit used; 1 % for pixels near borders and emitters.
    used = fit.segment >= 0
    assert fit.segment_albedo[fit.segment[used]].mean() == pytest.approx(0.5, rel=0.01)
    ratio = fit.intensity / room.truth
    assert np.abs(ratio / ratio.mean(0) - 1).max() < 0.03  # lights against each other, free of the scale
    assert (fit.standard_error > 0.3 * fit.intensity).all()  # the scale's own 35 %


def test_scale_of_the_photograph_carries_over(room):
    brighter = replace(room, maps=replace(room.maps, photograph=7 * room.maps.photograph))
    assert _fit(brighter).intensity == pytest.approx(7 * _fit(room).intensity, rel=1e-3)  # solver tolerance


def test_unit_of_a_light_does_not_matter(room):
    factor = np.array([1e-3, 1, 1e4, 10.0])
    rescaled = replace(room, maps=replace(room.maps, basis=room.maps.basis * factor[:, None, None, None]))
    # The same numbers up to rounding, amplified by the solver's stopping rule.
    assert _fit(rescaled).intensity * factor[:, None] == pytest.approx(_fit(room).intensity, rel=1e-4)


def test_given_intensity_is_kept_and_scales_the_others(room):
    fit = _fit(room, given={1: room.truth[1]})
    assert (fit.intensity[1] == room.truth[1]).all() and not fit.standard_error[1].any()
    assert fit.scale_source == "given intensity"
    # One light of four carries the scale, against a prior on the albedo of nine surfaces.
    assert _worst(fit, room) < 0.05


def test_measured_emitter_fixes_the_scale(room):
    fit = _fit(room, measured={0: room.truth[0]})
    assert fit.scale_source == "emitter pixel"
    assert _worst(fit, room) < 0.1  # a radiance good to 5 %, against the prior on albedo


def test_emitter_pixel_wins_over_a_wrong_annotated_albedo(room):
    annotated = _annotated(room)
    wrong = tuple((mask, np.minimum(1.4 * albedo, 1)) for mask, albedo in annotated.maps.annotated)
    annotated = replace(annotated, maps=replace(annotated.maps, annotated=wrong))
    fit = _fit(annotated, measured=dict(enumerate(room.truth)))
    # lamps that show their radiance keep it; 3 % is what the contradicted wall still pulls
    assert _worst(fit, room) < 0.03
    assert any("contradicts the lights" in message for message in fit.messages)


def test_clipped_emitter_is_a_lower_bound(room):
    bound = 3 * room.truth[2]
    fit = _fit(_annotated(room), at_least={2: bound})
    assert (fit.intensity[2] >= bound * (1 - 1e-9)).all()
    assert any("'wall lamp' stands at the least" in message for message in fit.messages)
    low = _fit(_annotated(room), at_least={2: room.truth[2] / 3})
    assert _worst(low, room) < 0.02  # a bound that does not bind changes nothing


def test_light_that_is_off_is_zero(room):
    truth = room.truth.copy()
    truth[3] = 0
    photograph = room.albedo * np.einsum("lhwc,lc->hwc", room.maps.basis, truth)
    off = _annotated(replace(room, maps=replace(room.maps, photograph=photograph)))
    fit = _fit(off)
    assert (fit.intensity[3] < 0.01 * room.truth[3]).all()
    assert np.abs(fit.intensity[:3] / truth[:3] - 1).max() < 0.02


@pytest.mark.parametrize("copies", [2, 3])
def test_lights_of_one_footprint_are_reported_and_their_sum_holds(room, copies):
    order = [0, 1] + [1] * (copies - 1)
    maps = replace(room.maps, basis=room.maps.basis[order], emitter=np.full_like(room.maps.emitter, -1))
    truth = room.truth[order] * np.array([1, 0.7] + [0.3 / (copies - 1)] * (copies - 1))[:, None]
    photograph = room.albedo * np.einsum("lhwc,lc->hwc", maps.basis, truth)
    names = ("lamp", "left window", "right window", "third window")[: copies + 1]
    twins = _annotated(replace(room, maps=replace(maps, photograph=photograph), names=names, truth=truth))
    fit = _fit(twins)
    assert set(fit.inseparable) == {(i, j) for i in range(1, copies + 1) for j in range(i + 1, copies + 1)}
    assert any("'left window' and 'right window'" in m and "by hand" in m for m in fit.messages)
    assert fit.intensity[1:].sum(0) == pytest.approx(truth[1:].sum(0), rel=0.02)  # as for an exact basis
    assert fit.intensity[0] == pytest.approx(truth[0], rel=0.02)
    assert fit.intensity[1] == pytest.approx(fit.intensity[2], rel=0.05)  # shared evenly
    resolved = _fit(twins, given={light: truth[light] for light in range(2, copies + 1)})
    assert resolved.inseparable == ()
    assert _worst(resolved, twins) < 0.02


def test_nearly_equal_footprints_are_reported():
    twins = _developed(_annotated(_room(["ceiling lamp", "window", "lamp 5 cm beside"])))
    fit = _fit(twins)
    assert fit.inseparable == ((0, 2),)
    # 8 bits, clipping and 5 % of foreign objects leave the sum within 5 %; either lamp may be far off.
    assert fit.intensity[[0, 2]].sum(0) == pytest.approx(twins.truth[[0, 2]].sum(0), rel=0.05)


def test_light_without_influence_is_zero_and_reported(room):
    basis = np.concatenate([room.maps.basis, np.zeros_like(room.maps.basis[:1])])
    maps = replace(_annotated(room).maps, basis=basis)
    names = (*room.names, "hidden lamp")
    fit = estimate_intensities(maps, names)
    assert not fit.intensity[4].any() and np.isinf(fit.standard_error[4]).all()
    assert any("'hidden lamp' reaches no usable pixel" in message for message in fit.messages)
    assert np.abs(fit.intensity[:4] / room.truth - 1).max() < 0.02
    known = estimate_intensities(maps, names, given={4: np.array([5.0, 4, 3])})
    assert known.intensity[4].tolist() == [5, 4, 3]
    bound = estimate_intensities(maps, names, at_least={4: np.array([1.0, 1, 1])})
    assert bound.intensity[4].tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    "value, clipped", [(0.0, False), (1.0, True), (np.nan, False)], ids=["black", "clipped", "not a number"]
)
def test_photograph_that_shows_nothing(room, value, clipped):
    empty = replace(
        room.maps,
        photograph=np.full_like(room.maps.photograph, value),
        clipped=np.full(room.maps.surface.shape, clipped),
    )
    with pytest.raises(InputError, match="no pixel of the photograph.*give the intensity of ceiling lamp"):
        estimate_intensities(empty, room.names)
    fit = estimate_intensities(empty, room.names, given=dict(enumerate(room.truth)))
    assert (fit.intensity == room.truth).all() and "nothing was fitted" in fit.messages[0]
    _assert_sane(fit)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (3, 3)])
def test_tiny_photographs(room, shape):
    cut = np.s_[60 : 60 + shape[0], 60 : 60 + shape[1]]
    maps = room.maps
    tiny = EstimationMaps(
        maps.photograph[cut], maps.basis[:, *cut], maps.surface[cut], maps.emitter[cut], maps.clipped[cut]
    )
    fit = estimate_intensities(tiny, room.names)
    _assert_sane(fit)
    # Whatever is known of the lights, together they give the radiance seen at albedo 0.5.
    model = fit.albedo * np.einsum("lhwc,lc->hwc", tiny.basis, fit.intensity)
    assert np.median(model / tiny.photograph) == pytest.approx(1, rel=0.02)


def test_invalid_pixels_and_empty_channel_stay_finite(room):
    photograph = _annotated(room).maps.photograph.copy()
    photograph[10:30, 20:40] = np.nan
    photograph[50:60, 20:40] = np.inf
    photograph[..., 2] = 0  # sodium light
    fit = _fit(replace(room, maps=replace(room.maps, photograph=photograph)))
    _assert_sane(fit)
    assert (fit.intensity[:, 2] <= 0.05 * fit.intensity[:, 0]).all()


def test_mistakes_are_refused(room):
    with pytest.raises(InputError, match="the scene has no lights"):
        estimate_intensities(replace(room.maps, basis=room.maps.basis[:0]), ())
    with pytest.raises(InputError, match="radiance .* of light 'window' is no colour"):
        _fit(room, measured={1: np.array([1, -1, 1.0])})
    bad = replace(room.maps, annotated=((_patch(room)[0], np.array([0.5, 1.5, 0.5])),))
    with pytest.raises(InputError, match=r"annotated albedo \[0.5, 1.5, 0.5\]"):
        estimate_intensities(bad, room.names)
    with pytest.raises(ValueError, match="basis"):
        estimate_intensities(room.maps, room.names[:2])


def test_annotation_outside_the_usable_pixels_is_said(room):
    nowhere = replace(room.maps, annotated=((np.zeros(room.maps.surface.shape, bool), np.full(3, 0.5)),))
    fit = estimate_intensities(nowhere, room.names)
    assert fit.scale_source == "default albedo 0.5"
    assert any("annotated albedo 1 covers no usable pixel" in message for message in fit.messages)


def test_reduction_keeps_the_maps_consistent(large_room):
    maps = _developed(_annotated(large_room)).maps
    small = reduce_for_estimation(maps, 160)
    assert small.surface.shape == (120, 160) and small.basis.shape == (4, 120, 160, 3)
    blocks = maps.photograph.reshape(120, 3, 160, 3, 3).mean((1, 3))
    assert small.photograph == pytest.approx(blocks, abs=1e-6)  # single precision
    assert (small.clipped == maps.clipped.reshape(120, 3, 160, 3).any((1, 3))).all()
    assert ((small.emitter >= 0) == (maps.emitter >= 0).reshape(120, 3, 160, 3).any((1, 3))).all()
    assert set(np.unique(small.surface)) <= set(np.unique(maps.surface))
    assert reduce_for_estimation(small, 160) is small


def test_runs_in_three_seconds(large_room):
    hard = _developed(_annotated(_tiles(large_room)))
    began = time.process_time()
    _fit(hard)
    assert time.process_time() - began < 6  # 0.9 s of processor time on one core when measured; 3 s asked


def test_albedo_of_the_pixels(large_room):
    tiled = _annotated(_tiles(large_room))
    fit = _fit(tiled)
    plain = (tiled.maps.emitter < 0) & ~ndimage.binary_dilation(tiled.maps.emitter >= 0, iterations=3)
    # Exact basis: what is left is the intensities' 1 %, at every pixel, grout and all.
    assert np.percentile(np.abs(fit.albedo / tiled.albedo - 1)[plain], 95) < 0.02
