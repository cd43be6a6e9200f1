"""Sun direction from posts and their shadows: light of known direction is cast over level ground and found again."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.estimation.spherical import angles_between
from pipeline.estimation.sun_from_shadow import direction_from_shadows
from pipeline.geometry.camera import Camera, rotation

#: Somebody's eye, 1.6 m above a street; f = 900 is 58 degrees across 1000 pixels.
CAMERA = Camera(1000, 700, 900.0, np.array([500.0, 350.0]), rotation(pitch=-8), np.array([0.0, 1.6, 0.0]))


def sunlight(elevation, azimuth):
    """Direction of sunlight; azimuth [degree] 0 shines away from the camera, 90 to the right."""
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.sin(a), -np.sin(e), -np.cos(e) * np.cos(a)])


def post(direction, foot=(0.0, -8.0), height=2.0, camera=CAMERA):
    """(foot, tip, shadow) [pixel] of a post at (x, z) [m]; None where its shadow is not before the camera."""
    base = np.array([foot[0], 0.0, foot[1]])
    tip = base + [0, height, 0]
    pixels, depth = camera.project(np.array([base, tip, tip - direction * height / direction[1]]))
    return tuple(pixels) if depth.min() > 0.3 else None


def in_picture(shadow, camera=CAMERA):
    return shadow is not None and all((p >= 0).all() and (p <= [camera.width, camera.height]).all() for p in shadow)


def off(found, direction):
    """Degrees between what was found and the truth."""
    return float(np.degrees(angles_between(found.direction, direction)))


def clicked(shadows, noise, rng):
    return [tuple(p + rng.normal(0, noise, 2) for p in shadow) for shadow in shadows]


@pytest.mark.parametrize("pitch, roll", [(0, 0), (-25, 0), (10, 4), (-8, -12)])
def test_exact_clicks_give_the_direction_back(pitch, roll):
    camera = Camera(1000, 700, 900.0, np.array([480.0, 360.0]), rotation(20, pitch, roll), np.array([3, 1.6, -2.0]))
    ahead = camera.position + 8 * camera.world_from_camera[:, 2]
    tried = 0
    for elevation in (2, 5, 15, 35, 60, 85):
        for azimuth in range(0, 360, 15):
            true = sunlight(elevation, azimuth)
            one = post(true, ahead[[0, 2]], camera=camera)
            if one is not None:
                tried += 1
                found = direction_from_shadows(camera, [one], 2.0, 0, trials=1)
                # 1e-12 in a pixel of 1000 grows by the low sun's leverage, 1/sin^2, to some 1e-9 degrees
                assert off(found, true) < 1e-8, (elevation, azimuth)
    assert tried > 100, "a shadow that runs behind the camera is none; most must not"


@pytest.mark.parametrize("elevation", [3, 30, 70])
def test_several_posts_give_the_direction_back(elevation):
    true = sunlight(elevation, 70)
    posts = [post(true, foot, height) for foot, height in (((-3, -9), 1.2), ((0, -12), 2.5), ((1, -6), 0.8))]
    found = direction_from_shadows(CAMERA, posts, 2.0, 0, trials=20)
    assert off(found, true) < 1e-4, "the simplex stops at 1e-7 radian, 6e-6 degrees"
    assert found.rms < 1e-4 and found.agree


def test_sun_in_the_zenith_has_its_shadow_at_the_foot():
    foot, tip, _ = post(sunlight(90, 0))
    for count in (1, 3):
        found = direction_from_shadows(CAMERA, [(foot, tip, foot)] * count, 1.0, 0)
        assert found.direction == pytest.approx([0, -1, 0], abs=1e-7)
        assert 0 < found.confidence < 5


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_unit_of_length_does_not_matter(scale):
    camera = Camera(1000, 700, 900.0, np.array([500.0, 350.0]), rotation(pitch=-8), np.array([0.0, 1.6 * scale, 0.0]))
    shadows = clicked([post(sunlight(35, 60)), post(sunlight(35, 60), (2, -7))], 2.0, np.random.default_rng(0))
    metres, other = (direction_from_shadows(c, shadows, 2.0, 0, trials=10) for c in (CAMERA, camera))
    assert other.direction == pytest.approx(metres.direction, abs=1e-6)
    assert other.confidence == pytest.approx(metres.confidence, rel=1e-3)


def trials(posts, true, *, noise=2.0, count=50, resampled=100):
    """Errors and stated cones [degree] of so many seeded sets of clicks."""
    errors, cones = [], []
    for seed in range(count):
        found = direction_from_shadows(CAMERA, clicked(posts, noise, np.random.default_rng(seed)), noise, seed, resampled)
        errors.append(off(found, true))
        cones.append(found.confidence)
    return np.array(errors), np.array(cones)


@pytest.mark.parametrize("elevation, azimuth, foot, median, worst", [
    # two pixels at 8 m and f = 900 are 2 cm across, but 10 cm of depth on ground seen from 1.6 m: of a shadow as long
    # as its post, 2 m, three degrees; a shadow three times as long leaves one, one of a third as much less than four
    (20, 90, -3.5, 1.5, 5), (35, 60, -2.0, 3, 9), (35, 180, -2.0, 3, 9), (70, 120, -2.0, 4, 12)])
def test_two_pixels_of_noise(elevation, azimuth, foot, median, worst):
    true = sunlight(elevation, azimuth)
    single = post(true, (foot, -8.0))
    assert in_picture(single)
    errors, cones = trials([single], true, resampled=200)
    inside = (errors <= cones).mean()
    print(f"{elevation}, {azimuth}: median {np.median(errors):.2f}, worst {errors.max():.2f} degrees,"
          f" cone {np.median(cones):.2f}, holds {inside:.0%}")
    assert np.median(errors) < median and errors.max() < worst
    assert inside >= 0.9, "a 95 % cone, 50 times: below 45 in one of 30 experiments"


def test_three_posts_are_better_than_one_and_their_cone_holds_the_truth():
    true = sunlight(35, 60)
    posts = [post(true, foot) for foot in ((-3, -8), (-1, -9), (0.5, -10))]
    assert all(map(in_picture, posts))
    (one, _), (three, cones) = trials(posts[:1], true), trials(posts, true, resampled=40)
    inside = (three <= cones).mean()
    print(f"one: median {np.median(one):.2f}; three: {np.median(three):.2f}, worst {three.max():.2f}, holds {inside:.0%}")
    assert np.median(three) < np.median(one)
    assert inside >= 0.86, "40 resamples place the cone roughly: 93 % of the truths lie in it; below 43 of 50 in one of 30"


def test_long_shadow_is_more_certain_than_a_short_one():
    low, high = (direction_from_shadows(CAMERA, [post(sunlight(elevation, 60))], 2.0, 0) for elevation in (10, 60))
    assert low.confidence < high.confidence / 2


def test_shadow_near_the_horizon_says_that_it_says_nothing():
    foot, tip, _ = post(sunlight(30, 0))
    horizon = 350 - 900 * np.tan(np.radians(8))
    found = direction_from_shadows(CAMERA, [(foot, tip, np.array([520.0, horizon + 1]))], 2.0, 0)
    assert found.confidence > 30, "half of the clicks two pixels round it are in the sky"


def test_another_things_shadow_is_noticed():
    true = sunlight(35, 60)
    posts = [post(true, foot) for foot in ((-3, -8), (-1, -9), (0.5, -10))]
    foot, tip, shadow = posts[1]
    for wrong, what in ((posts[1][0] * 0.5 + posts[2][2] * 0.5, "its neighbour's"), (shadow + [60, 0], "off")):
        found = direction_from_shadows(CAMERA, [posts[0], (foot, tip, wrong), posts[2]], 2.0, 0)
        assert not found.agree and np.argmax(found.residuals) == 1, what
        assert off(found, true) < found.confidence, "the cone grows with the disagreement"
    steady = direction_from_shadows(CAMERA, clicked(posts, 2.0, np.random.default_rng(3)), 2.0, 0)
    assert steady.agree


def test_honest_clicks_seldom_disagree():
    true = sunlight(40, -50)
    posts = [post(true, foot) for foot in ((3, -8), (-1, -9))]
    agreed = [direction_from_shadows(CAMERA, clicked(posts, 2.0, np.random.default_rng(seed)), 2.0, seed, 100).agree
              for seed in range(12)]
    assert sum(agreed) >= 10, "each disagrees by chance once or twice in a hundred"


def test_same_seed_same_answer():
    shadows = [post(sunlight(35, 60)), post(sunlight(35, 60), (2, -7))]
    one, other = (direction_from_shadows(CAMERA, shadows, 2.0, 5, 20) for _ in range(2))
    assert np.array_equal(one.direction, other.direction) and one.confidence == other.confidence


SKY, GROUND = np.array([500.0, 100.0]), np.array([500.0, 420.0])


@pytest.mark.parametrize("shadow, says", [
    ((SKY, SKY - [0, 50], GROUND), r"\[500, 100\] lies above the horizon; click it on the ground"),
    ((GROUND, SKY, SKY), r"\[500, 100\] lies above the horizon"),
    ((GROUND, GROUND, GROUND + [50, 0]), r"the tip \[500.0, 420.0\] is not above its foot \[500.0, 420.0\]"),
    ((GROUND, GROUND + [0, 30], GROUND + [50, 0]), "is not above its foot"),
    ((GROUND, GROUND + [200, 10], GROUND + [50, 0]), "is not above its foot"),
], ids=["foot in the sky", "shadow in the sky", "no height", "tip below foot", "tip beside foot"])
def test_clicks_that_are_refused(shadow, says):
    with pytest.raises(InputError, match=says):
        direction_from_shadows(CAMERA, [shadow], 2.0, 0)


def test_camera_in_the_ground_sees_no_shadow():
    buried = Camera(1000, 700, 900.0, np.array([500.0, 350.0]), rotation(), np.array([0.0, -1.0, 0.0]))
    with pytest.raises(InputError, match="above the horizon"):
        direction_from_shadows(buried, [(GROUND, SKY, GROUND)], 2.0, 0)
