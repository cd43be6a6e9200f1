"""Borders refined against photographs that are mixed from known colours by a known alpha, and fog on them.

Outlines are drawn a few pixels off, as people draw. Errors are of alpha, and of the foggy picture in photo units.
"""

import cv2
import numpy as np
import pytest

from pipeline.geometry.camera import from_field_of_view
from pipeline.geometry.regions import Region, cut, depth_of_regions
from pipeline.imaging import edges
from pipeline.imaging.edges import refined
from pipeline.physics.layers import mixed_transmittance

SHAPE = (96, 128)
RADIUS = 6
NEAR, FAR = 20.0, 2000.0
EXTINCTION, AIRLIGHT = 0.03, 0.7
SKY, DARK = np.array([0.8, 0.85, 0.95]), np.array([0.05, 0.06, 0.04])
BRICK, GRASS = np.array([0.25, 0.22, 0.2]), np.array([0.15, 0.25, 0.08])
PAIRS = {"dark on sky": (DARK, SKY), "brick on grass": (BRICK, GRASS), "light on dark": (SKY, DARK)}


def coverage(inside, shape=SHAPE, samples=8) -> np.ndarray:
    """Share of each pixel (H, W) that lies inside; inside(u, v) of positions [pixel]."""
    v, u = (np.mgrid[:shape[0] * samples, :shape[1] * samples] + 0.5) / samples
    return inside(u, v).reshape(shape[0], samples, shape[1], samples).mean((1, 3))


def pole(width, off=0.0):
    """Slightly slanted, from the lower edge up to row 10."""
    return lambda u, v: (np.abs(u - 64 - off - 0.05 * (v - 48)) < width / 2) & (v > 10)


def disc(radius, off=0.0):
    return lambda u, v: np.hypot(u - 64 - off, v - 48) < radius


def crown(u, v):
    """A ragged crown of radius 26 with forty holes of 1 to 5 pixels across."""
    rng = np.random.default_rng(1)
    inside = disc(26)(u, v + 2 * np.sin(u))
    for x, y, r in zip(rng.uniform(40, 88, 40), rng.uniform(24, 72, 40), rng.uniform(0.7, 2.5, 40)):
        inside &= np.hypot(u - x, v - y) > r
    return inside


class Mixed:
    """A photograph of something near before something far, its true alpha (H, W), and what was drawn (H, W) of it."""

    def __init__(self, alpha, drawn, front, behind, noise=0.003, depths=(NEAR, FAR)):
        rng = np.random.default_rng(0)
        self.alpha, self.drawn, self.depths = alpha, drawn, depths
        self.front, self.behind = (np.maximum(colour + noise * rng.normal(size=(*alpha.shape, 3)), 0)
                                   for colour in (front, behind))
        self.photograph = alpha[..., None] * self.front + (1 - alpha[..., None]) * self.behind
        self.depth = np.where(drawn, *depths)
        # where there is anything to get wrong, and a radius round it
        unsure = ((alpha > 0) & (alpha < 1)) | (drawn != (alpha > 0.5))
        self.band = cv2.dilate(unsure.astype(np.uint8), np.ones((2 * RADIUS + 1, 2 * RADIUS + 1))) > 0

    def layers(self, radius=RADIUS, porous=False):
        return refined(self.photograph, self.drawn.astype(int), self.depth, self.drawn & porous, radius)

    def near_share(self, layers) -> np.ndarray:
        """Alpha (H, W) of the near thing, as refined."""
        two = layers.front_depth != layers.behind_depth
        return np.where(two, layers.alpha, layers.front_depth == self.depths[0])

    def fogged(self) -> np.ndarray:
        near, far = (np.exp(-EXTINCTION * d) for d in self.depths)
        a = self.alpha[..., None]
        return (a * (self.front * near + AIRLIGHT * (1 - near))
                + (1 - a) * (self.behind * far + AIRLIGHT * (1 - far)))

    def off(self, radius=RADIUS, porous=False) -> tuple[float, float]:
        """Mean error of alpha, and of the foggy picture, along the border."""
        layers = self.layers(radius, porous)
        wrong = np.abs(composed(self.photograph, layers) - self.fogged()).max(-1)
        return np.abs(self.near_share(layers) - self.alpha)[self.band].mean(), wrong[self.band].mean()


def composed(photograph, layers) -> np.ndarray:
    """R T + V (H, W, 3) with the T and V that the pipeline mixes of two layers, in even fog."""
    front, behind = (np.exp(-EXTINCTION * d)[..., None] for d in (layers.front_depth, layers.behind_depth))
    a = layers.alpha[..., None]
    return photograph * transmittance(layers) + AIRLIGHT * (a * (1 - front) + (1 - a) * (1 - behind))


def transmittance(layers) -> np.ndarray:
    front, behind = (np.exp(-EXTINCTION * d)[..., None] * np.ones(3) for d in (layers.front_depth, layers.behind_depth))
    return mixed_transmittance(layers.alpha, layers.front, layers.behind, front, behind)


# ---- the truth comes back ----------------------------------------------------------------------------------------

@pytest.mark.parametrize("off, wider", [(0, 1), (2, 0), (3, 2)])
@pytest.mark.parametrize("width", [2, 4, 10, 30])
@pytest.mark.parametrize("pair", PAIRS)
def test_poles(pair, width, off, wider):
    scene = Mixed(coverage(pole(width)), coverage(pole(width + 2 * wider, off)) > 0.5, *PAIRS[pair])
    alpha, fog = scene.off()
    drawn_alpha, drawn_fog = scene.off(radius=0)
    # of a pole of two pixels few are the pole alone: its colour, and so its share, comes out a little wrong
    assert alpha < (0.012 if width == 2 else 0.008) and fog < 0.005
    assert alpha < drawn_alpha / 5 and fog < drawn_fog / 5


@pytest.mark.parametrize("off", [-1, 0, 2])
@pytest.mark.parametrize("width", [0.6, 1])
def test_wires_keep_a_fog_of_their_own(width, off):
    # drawn as wide as a pixel and more, beside the wire or round it
    scene = Mixed(coverage(pole(width)), coverage(pole(2, off)) > 0.5, DARK, SKY)
    alpha, fog = scene.off()
    # of a wire nothing is seen alone: its colour keeps some of the sky, and so its share is too great
    assert alpha < (0.025 if width == 1 else 0.035) and fog < 0.005
    assert fog < scene.off(radius=0)[1] / 2.5
    share = scene.near_share(scene.layers())[20:90].sum(1)
    assert share.mean() == pytest.approx(width, abs=0.5) and share.min() > 0.5 * width  # and unbroken


@pytest.mark.parametrize("off", [0, 2, 4])
@pytest.mark.parametrize("pair", PAIRS)
def test_discs(pair, off):
    scene = Mixed(coverage(disc(25)), coverage(disc(25, off)) > 0.5, *PAIRS[pair])
    alpha, fog = scene.off()
    assert alpha < 0.01 and fog < 0.003
    assert fog < scene.off(radius=0)[1] / (3 if off == 0 else 20)


@pytest.mark.parametrize("pair", ["dark on sky", "brick on grass"])
def test_holes_in_a_crown_show_what_is_behind_it(pair):
    scene = Mixed(coverage(crown), coverage(disc(28)) > 0.5, *PAIRS[pair])
    alpha, fog = scene.off(porous=True)
    assert alpha < 0.012 and fog < scene.off(radius=0)[1] / 10
    # what is not said to be porous has no holes away from its outline
    layers = scene.layers()
    deep = coverage(disc(28 - 1.5 * RADIUS - 1)) > 0.999
    assert (scene.near_share(layers)[deep] == 1).all() and (scene.alpha[deep] < 0.5).any()


def test_the_bright_halo_is_gone():
    scene = Mixed(coverage(disc(25)), coverage(disc(28)) > 0.5, DARK, SKY)
    halo = scene.drawn & (scene.alpha == 0)
    too_bright = [(composed(scene.photograph, scene.layers(radius)) - scene.fogged())[halo].mean()
                  for radius in (0, RADIUS)]
    # clear sky shines where the outline says the near disc is
    assert too_bright[0] > 0.05 and abs(too_bright[1]) < too_bright[0] / 30


def motley(colour, amount) -> np.ndarray:
    """Blotches some pixels across, of a standard deviation in photo units."""
    blotches = cv2.GaussianBlur(np.random.default_rng(3).normal(size=(*SHAPE, 3)), (0, 0), 2)
    return np.clip(colour + amount * blotches / blotches.std(), 0, None)


def test_texture_behind_is_no_thing_in_front():
    scene = Mixed(coverage(pole(10)), coverage(pole(10, 2)) > 0.5, SKY, motley(GRASS, 0.05))
    alpha, fog = scene.off()
    assert alpha < 0.02 and fog < scene.off(radius=0)[1] / 8


@pytest.mark.parametrize("amount", [0.03, 0.06, 0.1])
def test_where_texture_says_more_than_the_border_what_was_drawn_holds(amount):
    for inside, drawn in ((pole(10), pole(10, 1)), (disc(25), disc(25, 1))):
        scene = Mixed(coverage(inside), coverage(drawn) > 0.5, BRICK, motley(BRICK, amount))
        assert scene.off()[0] < 1.1 * scene.off(radius=0)[0]  # as good as the outline, within a tenth


def test_faint_borders_are_followed_by_the_guided_filter():
    # a fiftieth of photo white, in one channel three times: for the library a singular guide, if its values are small
    scene = Mixed(coverage(disc(25)), coverage(disc(25, 1)) > 0.5, 0.25 * np.ones(3), 0.27 * np.ones(3), noise=0.001)
    assert scene.off()[0] < 0.75 * scene.off(radius=0)[0]


def test_without_difference_in_colour_what_was_drawn_holds():
    scene = Mixed(coverage(disc(25)), coverage(disc(25)) > 0.5, BRICK, BRICK)
    share = scene.near_share(scene.layers())
    # a soft border of a third of the radius instead of the drawn one, and no further
    away = cv2.distanceTransform(scene.drawn.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform((~scene.drawn).astype(np.uint8), cv2.DIST_L2, 5)
    assert (share[away > 5] > 0.99).all() and (share[outside > 5] < 0.01).all()


def test_what_was_drawn_takes_over_beyond_the_radius():
    """Something dark behind, that begins right beside a dark thing's true border and runs away from it."""
    scene = Mixed(coverage(lambda u, v: u < 64), coverage(lambda u, v: u < 64) > 0.5, DARK, SKY, noise=0)
    scene.photograph[44:52, 64:] = DARK
    share = scene.near_share(scene.layers())[48, 64:]
    assert share[:RADIUS - 1].min() > 0.8  # nothing tells it from the thing, as far as that may reach
    assert (np.diff(share) <= 0.01).all() and share[int(1.4 * RADIUS)] < 0.1 and share[2 * RADIUS] == 0


# ---- laws ----------------------------------------------------------------------------------------------------------

def strange(name: str) -> np.ndarray:
    rng = np.random.default_rng(5)
    return {"black": np.zeros((*SHAPE, 3)), "clipped": np.ones((*SHAPE, 3)), "grey": np.full((*SHAPE, 3), 0.2),
            "noise": rng.uniform(size=(*SHAPE, 3)), "beyond white": np.exp(rng.normal(0, 4, (*SHAPE, 3))),
            "half black": rng.uniform(size=(*SHAPE, 3)) * (np.arange(128) < 64)[:, None],
            "one channel": rng.uniform(size=(*SHAPE, 3)) * [1, 0, 0],
            "tiny": 1e-30 * rng.uniform(size=(*SHAPE, 3)), "huge": 1e30 * rng.uniform(size=(*SHAPE, 3))}[name]


@pytest.mark.parametrize("radius", [0, 1, 6, 40])
@pytest.mark.parametrize("name", ["black", "clipped", "grey", "noise", "half black", "beyond white", "one channel",
                                  "tiny", "huge"])
def test_layers_mix_to_the_photograph(name, radius):
    photograph = strange(name)
    drawn = coverage(disc(25)) > 0.5
    layers = refined(photograph, drawn.astype(int), np.where(drawn, NEAR, FAR), drawn, radius)
    mix = layers.alpha[..., None] * layers.front + (1 - layers.alpha[..., None]) * layers.behind
    np.testing.assert_allclose(mix, photograph, rtol=1e-12)
    for values in vars(layers).values():
        assert np.isfinite(values).all() and values.min() >= 0
    assert layers.alpha.max() <= 1 and (layers.front_depth <= layers.behind_depth).all()
    assert set(np.unique(layers.front_depth)) <= {NEAR, FAR}
    t = transmittance(layers)
    assert (t <= np.exp(-EXTINCTION * NEAR) + 1e-12).all() and (t >= np.exp(-EXTINCTION * FAR) - 1e-12).all()


def test_negative_radiance_outside_rec709_counts_as_none():
    photograph = Mixed(coverage(disc(25)), coverage(disc(25)) > 0.5, DARK, SKY).photograph
    photograph[40:50, 40:50, 2] = -0.01
    drawn = coverage(disc(25)) > 0.5
    layers = refined(photograph, drawn.astype(int), np.where(drawn, NEAR, FAR), drawn, RADIUS)
    mix = layers.alpha[..., None] * layers.front + (1 - layers.alpha[..., None]) * layers.behind
    np.testing.assert_allclose(mix, np.maximum(photograph, 0), rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_the_photographs_unit_does_not_matter(scale):
    scene = Mixed(coverage(pole(4)), coverage(pole(6, 2)) > 0.5, DARK, SKY)
    layers = scene.layers()
    scene.photograph = scene.photograph * scale
    np.testing.assert_allclose(scene.layers().alpha, layers.alpha, atol=1e-4)  # of 32 bits, along little-differing sums


def test_no_step_no_border():
    drawn = coverage(disc(25)) > 0.5
    photograph = strange("noise")
    layers = refined(photograph, drawn.astype(int), np.where(drawn, 100.0, 110.0), drawn, RADIUS)
    assert (layers.alpha == 1).all() and (layers.front_depth == layers.behind_depth).all()
    np.testing.assert_array_equal(layers.front, photograph)


def test_tiles_are_no_seams(monkeypatch):
    scene = Mixed(coverage(crown), coverage(disc(28)) > 0.5, DARK, SKY)
    whole = scene.layers(radius=3, porous=True)
    monkeypatch.setattr(edges, "TILE", 40)
    monkeypatch.setattr(edges, "_BLOCK", 500)
    tiled = scene.layers(radius=3, porous=True)
    np.testing.assert_array_equal(tiled.behind_depth, whole.behind_depth)
    # the widest windows, for colours that are nowhere plain, end with their tile
    assert np.abs(tiled.alpha - whole.alpha).max() < 0.01


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (2, 2)])
def test_photographs_of_few_pixels(shape):
    drawn = np.arange(np.prod(shape)).reshape(shape) >= np.prod(shape) / 2
    photograph = np.where(drawn[..., None], DARK, SKY)
    layers = refined(photograph, drawn.astype(int), np.where(drawn, NEAR, FAR), np.zeros(shape, bool), RADIUS)
    mix = layers.alpha[..., None] * layers.front + (1 - layers.alpha[..., None]) * layers.behind
    np.testing.assert_allclose(mix, photograph, rtol=1e-12)


# ---- more than two things ----------------------------------------------------------------------------------------

def test_each_border_is_between_what_meets_there():
    """A pole before a house before the sky: behind the pole is the house below its roof, the sky above."""
    house, post = coverage(lambda u, v: v > 40), coverage(pole(4))
    photograph = house[..., None] * BRICK + (1 - house[..., None]) * SKY
    photograph = post[..., None] * DARK + (1 - post[..., None]) * photograph
    labels = np.where(coverage(pole(6, 1)) > 0.5, 2, np.where(house > 0.5, 1, 0))
    layers = refined(photograph, labels, np.array([FAR, 100.0, NEAR])[labels], np.zeros(SHAPE, bool), RADIUS)
    for rows, behind, colour in ((slice(15, 30), FAR, SKY), (slice(52, 90), 100.0, BRICK)):
        two = (layers.front_depth == NEAR) & (layers.behind_depth > NEAR)
        assert (layers.behind_depth[rows][two[rows]] == behind).all() and two[rows].any(1).all()
        assert np.abs(np.where(two, layers.alpha, 0)[rows] - post[rows]).mean() < 0.005
        shown = two[rows] & (layers.alpha[rows] < 0.5)
        np.testing.assert_allclose(layers.behind[rows][shown], np.broadcast_to(colour, (shown.sum(), 3)), atol=0.1)


def test_there_is_a_border_beside_a_pole_wherever_its_background_changes():
    """The lawn meets the house: neither is in front of the other there, and the pole is before both."""
    post = coverage(pole(4))
    labels = np.where(coverage(pole(4)) > 0.5, 2, np.where(np.arange(96)[:, None] > 60, 1, 0))
    photograph = post[..., None] * DARK + (1 - post[..., None]) * np.where(labels == 1, 0, 1)[..., None] * BRICK
    layers = refined(photograph, labels, np.array([100.0, 105.0, NEAR])[labels], np.zeros(SHAPE, bool), RADIUS)
    two = (layers.front_depth == NEAR) & (layers.behind_depth > NEAR)
    for row in range(12, 96):
        beside = np.flatnonzero(labels[row] == 2)
        assert two[row, beside[0] - 5:beside[-1] + 6].all(), row


def test_ground_behind_a_pole_is_as_far_as_it_is_there():
    view = from_field_of_view(128, 96, 60, camera_height=1.6)
    full = np.ones(SHAPE, bool)
    regions = [Region("sky", "sky", *cut(full)),
               Region("ground", "support", *cut(full & (np.arange(96) >= 48)[:, None])),
               Region("post", "vertical", *cut(coverage(pole(6)) > 0.5), depth=3.0)]
    found = depth_of_regions(view, regions, FAR)
    photograph = np.where(found.labels[..., None] == 2, DARK, GRASS)
    layers = refined(photograph, found.labels, found.depth, np.zeros(SHAPE, bool), RADIUS)
    ground = np.median(found.depth[:, :40], 1)
    for row in (60, 70):
        behind = layers.behind_depth[row][layers.alpha[row] < 0.5]
        # in the row or in the next: the nearest place beyond the border
        assert len(behind) and behind.min() > ground[row + 2] and behind.max() < ground[row - 2]


# ---- depth maps ----------------------------------------------------------------------------------------------------

def test_edges_of_a_depth_map_are_refined_too():
    scene = Mixed(coverage(disc(25)), coverage(disc(25, 2)) > 0.5, DARK, SKY)
    one = np.zeros(SHAPE, int)
    layers = refined(scene.photograph, one, scene.depth, np.zeros(SHAPE, bool), RADIUS)
    wrong = np.abs(composed(scene.photograph, layers) - scene.fogged()).max(-1)[scene.band].mean()
    assert wrong < scene.off(radius=0)[1] / 10


def test_ground_that_runs_to_the_horizon_has_no_edges_in_a_depth_map():
    view = from_field_of_view(128, 96, 60, camera_height=1.6)
    depth = depth_of_regions(view, [Region("g", "support", np.ones(SHAPE, bool))], FAR).depth
    layers = refined(strange("noise"), np.zeros(SHAPE, int), depth, np.zeros(SHAPE, bool), RADIUS)
    assert (layers.front_depth == layers.behind_depth).all()


# ---- transmittance of two layers -----------------------------------------------------------------------------------

def test_mixed_transmittance_keeps_the_papers_equation():
    rng = np.random.default_rng(0)
    alpha, (front, behind) = rng.uniform(size=50), rng.uniform(size=(2, 50, 3))
    near, far = rng.uniform(0.5, 1, (50, 3)), rng.uniform(0, 0.5, (50, 3))
    t = mixed_transmittance(alpha, front, behind, near, far)
    a = alpha[:, None]
    reflected = a * front + (1 - a) * behind
    np.testing.assert_allclose(reflected * t, a * front * near + (1 - a) * behind * far, rtol=1e-12)
    assert ((t >= far - 1e-12) & (t <= near + 1e-12)).all()


def test_mixed_transmittance_at_its_ends():
    near, far = np.full((4, 3), 0.8), np.full((4, 3), 0.1)
    alpha, black = np.array([1.0, 0.0, 0.5, 0.25]), np.zeros((4, 3))
    bright = np.ones((4, 3))
    np.testing.assert_allclose(mixed_transmittance(alpha, bright, bright, near, far)[:, 0], [0.8, 0.1, 0.45, 0.275])
    # black: by the shares; a black thing before the sky: what shines there is the sky
    np.testing.assert_allclose(mixed_transmittance(alpha, black, black, near, far)[:, 0], [0.8, 0.1, 0.45, 0.275])
    np.testing.assert_allclose(mixed_transmittance(alpha, black, bright, near, far)[1:, 0], 0.1)
    for scale in (1e-300, 1e300):
        np.testing.assert_allclose(mixed_transmittance(alpha, scale * bright, scale * bright, near, far)[:, 0],
                                   [0.8, 0.1, 0.45, 0.275])
