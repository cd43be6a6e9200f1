"""Sun and sky from patches: synthetic patches under known light, and a painted open-air scene through the stages."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.estimation.daylight import Patch, fit_daylight, patch_radiance
from pipeline.imaging.maps import write_map
from pipeline.scene.artefacts import read_json
from tests.test_bad_input import refusal

SKY, SUN = np.array([0.8, 0.9, 1.1]), np.array([3.0, 2.8, 2.4])
GROUND = np.array([0.10, 0.12, 0.08])
ALBEDO = np.array([0.20, 0.22, 0.18])
LEVEL, WALL = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
DOWN = np.array([0.3, -0.7, -0.4]) / np.sqrt(0.74)


def radiance(normal=LEVEL, albedo=ALBEDO, sun=SUN, sky_visibility=1.0, direction=DOWN):
    """What a diffuse surface shows (3,): the model of eq. 6, upright surfaces lit by the ground as well."""
    up = (1 + normal[1]) / 2
    return albedo * (up * sky_visibility * SKY + (1 - up) * GROUND) + albedo / np.pi * sun * max(-(normal @ direction), 0)


def patch(name, level, rng=None, *, size=(30, 30), texture=0.05, blur=1, odd=0.0, clip=np.inf, normal=LEVEL,
          albedo=ALBEDO, sky_visibility=1.0, ground=GROUND):
    """Pixels round a radiance: texture averaged over `blur` pixels, a share of leaves or paint, clipped at `clip`."""
    rng = rng or np.random.default_rng(0)
    even = cv2.blur(rng.normal(0, blur, (size[0] + 16, size[1] + 16)), (blur, blur))[8:-8, 8:-8, None]
    values = level * (1 + texture * even) + 0.01 * level * rng.normal(0, 1, (*size, 3))
    others = rng.random(size) < odd
    values[others] = level * rng.choice([0.2, 3.0], (int(others.sum()), 1))
    clipped = (values >= clip).any(-1)
    up = (1 + normal[1]) / 2
    return Patch(name, np.minimum(values, clip).reshape(-1, 3), clipped.ravel(), np.argwhere(np.ones(size)), albedo,
                 normal, up * sky_visibility, (1 - up) * ground)


SHADOWED, SUNLIT = radiance(sun=0), radiance()


# ---- the fit -----------------------------------------------------------------------------------

def test_even_patches_give_sun_and_sky_back():
    flat = [patch(name, level, texture=0) for name, level in (("shadowed", SHADOWED), ("sunlit", SUNLIT))]
    found = fit_daylight(flat[:1], flat[1:], DOWN)
    # 1 % of noise per pixel and channel, averaged over 900 pixels, is 0.03 %; the sun is a difference, three times that
    assert found.sky == pytest.approx(SKY, rel=2e-3) and found.sun == pytest.approx(SUN, rel=6e-3)
    assert found.messages == [] and found.patches["shadowed"]["pixels"] > 890


@pytest.mark.parametrize("options", [
    {}, {"blur": 3}, {"size": (40, 80), "blur": 5}, {"odd": 0.1}, {"size": (13, 13)},
    {"blur": 3, "clip": 1.05 * SUNLIT.max()}], ids=["pixels", "texture", "large", "leaves", "small", "clipped"])
def test_stated_errors_hold_the_truth(options):
    """Of 200 seeded patches two standard errors hold the truth about 95 times in a hundred, for sun and sky."""
    inside, off = [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        shadowed = [patch("shadowed", SHADOWED, rng, **{**options, "clip": np.inf})]
        found = fit_daylight(shadowed, [patch("sunlit", SUNLIT, rng, **options)], DOWN)
        inside.append([np.abs(found.sky - SKY) <= 2 * found.sky_error, np.abs(found.sun - SUN) <= 2 * found.sun_error])
        off.append([found.sky / SKY - 1, found.sun / SUN - 1])
    share, bias = np.mean(inside, (0, 2)), np.mean(off, (0, 2))
    print(f"{options}: sky {share[0]:.1%}, sun {share[1]:.1%} held; off by {np.std(off, (0, 2))}, on average {bias}")
    # 200 trials tell 95 % to 3 %; error bars may be wider than they must, but not narrower
    assert (share > 0.91).all()
    assert np.abs(bias).max() < 2e-3, "a tenth of what 5 % of texture leaves, and of what clipping would take"


def test_clipped_pixels_do_not_darken_the_sun():
    """A fifth of the patch is burnt out; leaving only those away would take 0.35 of its texture's deviation."""
    shadowed = [patch("shadowed", SHADOWED, size=(80, 80))]
    burnt = patch("sunlit", SUNLIT, size=(80, 80), clip=np.inf)
    clip = np.quantile(burnt.radiance.max(1), 0.8)
    burnt = patch("sunlit", SUNLIT, size=(80, 80), clip=clip)
    assert burnt.clipped.mean() == pytest.approx(0.2, abs=0.02)
    found = fit_daylight(shadowed, [burnt], DOWN)
    assert found.sun == pytest.approx(SUN, rel=0.01)
    naive = burnt.radiance[~burnt.clipped].mean(0)
    assert (found.patches["sunlit"]["radiance"] > naive * 1.01).all()


def test_clipped_paint_on_a_darker_surface_is_left_out():
    painted = patch("sunlit", SUNLIT, odd=0.15, clip=2 * SUNLIT.max())
    measured = patch_radiance(painted)
    assert measured.radiance == pytest.approx(SUNLIT, rel=0.01)
    assert measured.pixels == pytest.approx(0.85 * 900, rel=0.03)


@pytest.mark.parametrize("clip, says", [
    (0.99, "% of sunlit is clipped; left out"), (0.5, "100% of sunlit is clipped; left out")])
def test_burnt_out_patch_is_no_measure(clip, says):
    with pytest.raises(InputError, match=f"no sunlit patch can be used: .*{says}; outline evenly coloured ground in the sun"):
        fit_daylight([patch("shadowed", SHADOWED)], [patch("sunlit", SUNLIT, clip=clip * SUNLIT.min())], DOWN)


def test_patch_of_a_few_pixels_is_no_measure():
    with pytest.raises(InputError, match="no shadowed patch can be used: shadowed has fewer than 9 pixels; left out"):
        fit_daylight([patch("shadowed", SHADOWED, size=(2, 4))], [], None)
    tiny = fit_daylight([patch("shadowed", SHADOWED, size=(3, 3))], [], None)
    # too few for blocks: as uncertain as a single pixel
    assert (tiny.sky_error > 0.008 * SKY).all() and (np.abs(tiny.sky - SKY) < 3 * tiny.sky_error).all()


def test_photograph_of_few_codes():
    """More than half of the pixels share one code, so that the median deviation is 0: their neighbours are no outliers."""
    values = np.repeat([[0.100], [0.100], [0.100], [0.102]], 25, 0) * np.ones(3)
    one = Patch("codes", values, np.zeros(100, bool), np.argwhere(np.ones((10, 10))), ALBEDO, LEVEL, 1.0, np.zeros(3))
    assert patch_radiance(one).radiance == pytest.approx(np.full(3, 0.1005)) and patch_radiance(one).pixels == 100


def test_values_that_are_no_numbers_are_left_out():
    odd = patch("shadowed", SHADOWED)
    odd.radiance[::7] = np.nan
    odd.radiance[3::7] = np.inf
    assert fit_daylight([odd], [], None).sky == pytest.approx(SKY, rel=0.01)


def test_wall_is_lit_by_half_of_the_sky_and_by_the_ground():
    shadowed = [patch("shadowed", radiance(WALL, sun=0), normal=WALL)]
    lit = [patch("sunlit", radiance(WALL), normal=WALL)]
    assert -(WALL @ DOWN) > 0.3
    found = fit_daylight(shadowed, lit, DOWN)
    # 5 % of texture over 900 pixels is 0.2 %, which the smaller share of the sky in it raises to 0.4 %
    assert found.sky == pytest.approx(SKY, rel=0.01) and found.sun == pytest.approx(SUN, rel=0.01)
    without = fit_daylight([patch("shadowed", radiance(WALL, sun=0), normal=WALL, ground=0 * GROUND)], lit, DOWN)
    assert (without.sky > SKY * 1.05).all(), "what the ground throws back is not the sky's"


def test_wall_that_the_ground_alone_explains_is_reported():
    found = fit_daylight([patch("north wall", radiance(WALL, sun=0), normal=WALL, ground=20 * GROUND)], [], None)
    assert found.sky == pytest.approx(0)
    assert "what lies round north wall would alone make it as bright as it is; its albedo is too high" in found.messages[0]


def test_patch_that_sees_no_sky_tells_nothing_of_it():
    hidden = patch("arcade", 0.1 * SHADOWED, sky_visibility=0.01)
    found = fit_daylight([hidden, patch("open", SHADOWED)], [], None)
    assert found.messages == ["arcade sees nothing of the sky; left out"] and found.sky == pytest.approx(SKY, rel=0.01)
    with pytest.raises(InputError, match="no shadowed patch can be used: arcade sees nothing of the sky"):
        fit_daylight([hidden], [], None)


@pytest.mark.parametrize("visible", [0.3, 0.6])
def test_houses_that_hide_the_sky(visible):
    shadowed = [patch("shadowed", radiance(sun=0, sky_visibility=visible), sky_visibility=visible)]
    lit = [patch("sunlit", radiance(sky_visibility=0.8), sky_visibility=0.8)]
    found = fit_daylight(shadowed, lit, DOWN)
    assert found.sky == pytest.approx(SKY, rel=0.01) and found.sun == pytest.approx(SUN, rel=0.01)


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_scale_is_the_skys_and_not_the_suns(scale):
    """Zhao et al. 2013, section 5.2: L_sky = s I / (pi rho), while the sun is what the photograph adds to its I_sky."""
    plain, scaled = (fit_daylight([patch("shadowed", SHADOWED)], [patch("sunlit", SUNLIT)], DOWN, s)
                     for s in (1.0, scale))
    assert scaled.sky == pytest.approx(scale * plain.sky) and scaled.sky_error == pytest.approx(scale * plain.sky_error)
    assert scaled.sun == pytest.approx(plain.sun) and scaled.sun_error == pytest.approx(plain.sun_error)


def test_albedo_and_light_share_one_scale():
    """Twice the albedo explains the same photograph with half the light: only a stated albedo tells."""
    plain, bright = (fit_daylight([patch("shadowed", SHADOWED, albedo=a)], [patch("sunlit", SUNLIT, albedo=a)], DOWN)
                     for a in (ALBEDO, 2 * ALBEDO))
    assert bright.sky == pytest.approx(plain.sky / 2) and bright.sun == pytest.approx(plain.sun / 2)


def test_overcast_sky_has_no_sun():
    found = fit_daylight([patch("a", SHADOWED), patch("b", SHADOWED, np.random.default_rng(1))], [], None)
    assert found.sky == pytest.approx(SKY, rel=0.01)
    assert found.sun.tolist() == [0, 0, 0] and found.sun_error.tolist() == [0, 0, 0] and found.messages == []


def test_sunlit_patches_as_dark_as_the_shadowed_ones_may_be_an_overcast_sky():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        found = fit_daylight([patch("shadowed", SHADOWED, rng)], [patch("sunlit", SHADOWED, rng)], DOWN)
        assert "hardly brighter than the shadowed ones: this may be an overcast sky" in found.messages[-1]
        # 1 % of the sky's pi * L is 0.028
        assert (found.sun >= 0).all() and (found.sun <= np.maximum(3 * found.sun_error, 0.03)).all()


def test_exchanged_patches_are_refused():
    with pytest.raises(InputError, match="the sunlit patches are darker than the shadowed ones; exchange them, or leave out"):
        fit_daylight([patch("shadowed", SUNLIT)], [patch("sunlit", SHADOWED)], DOWN)


def test_a_sun_without_blue_is_reported():
    level = SHADOWED + (SUNLIT - SHADOWED) * [1, 1, -0.3]
    found = fit_daylight([patch("shadowed", SHADOWED)], [patch("sunlit", level)], DOWN)
    assert found.sun[2] == 0 and found.sun[:2] == pytest.approx(SUN[:2], rel=0.02)
    assert "in one channel the sunlit patches are darker" in found.messages[0]


def test_patches_that_agree_are_better_and_patches_that_disagree_are_named():
    rng = np.random.default_rng(2)
    agreeing = [patch(f"shadowed[{i}]", SHADOWED, rng) for i in range(4)]
    one, four = (fit_daylight(p, [], None) for p in (agreeing[:1], agreeing))
    assert (four.sky_error < one.sky_error * 0.8).all() and four.messages == []

    lawn = patch("shadowed[4]", SHADOWED * 2, rng)
    found = fit_daylight([*agreeing[:2], lawn], [], None)
    assert found.sky == pytest.approx(SKY, rel=0.01), "the median keeps to the two that agree"
    said, = found.messages
    assert re.search(r"the patches disagree about the sky: shadowed\[\d\] says 0.8\d+, shadowed\[4\] 1.7\d+; check", said)
    assert (found.sky_error > 0.2 * SKY).all(), "and the error says that one does not"


def test_sunlit_patches_that_disagree_are_named():
    found = fit_daylight([patch("shadowed", SHADOWED)], [patch("a", SUNLIT), patch("b", SHADOWED + 2 * (SUNLIT - SHADOWED))],
                         DOWN, GROUND)
    assert "disagree about the sun: a says" in found.messages[0]
    assert (found.sun_error > 0.3 * SUN).all()


def test_doubt_about_the_sky_is_doubt_about_the_sun():
    """However many sunlit patches there are: what is wrong with the sky is wrong in all of them."""
    sunlit = [patch(f"sunlit[{i}]", SUNLIT, np.random.default_rng(i), texture=0.01) for i in range(16)]
    rough = [patch("shadowed", SHADOWED, size=(13, 13), texture=0.3)]
    found = fit_daylight(rough, sunlit, DOWN)
    # a level patch sees pi of the sky's radiance where it sees cos of the sun's irradiance
    assert (found.sun_error >= np.pi / -DOWN[1] * found.sky_error * 0.999).all()


@pytest.mark.parametrize("elevation", [1.0, 5.0])
def test_grazing_sun_says_how_much_its_direction_matters(elevation):
    e = np.radians(elevation)
    low = np.array([np.cos(e), -np.sin(e), 0])
    lit = patch("sunlit", radiance(direction=low), texture=0.002)
    found = fit_daylight([patch("shadowed", SHADOWED, texture=0.002)], [lit], low)
    assert found.sun == pytest.approx(SUN, rel=0.02 / np.sin(e) * 0.05)
    said = next(m for m in found.messages if "degrees over sunlit" in m)
    assert f"the sun stands {elevation:.1f} degrees" in said
    share = float(re.search(r"strength by (\d+)%", said)[1]) / 100
    assert share == pytest.approx(np.pi / 180 / np.sin(e), abs=0.006)


def test_patch_that_the_sun_does_not_reach_is_left_out():
    away = patch("north", radiance(WALL, sun=0), normal=-WALL)
    found = fit_daylight([patch("shadowed", SHADOWED)], [away, patch("sunlit", SUNLIT)], DOWN)
    assert found.messages == ["north does not face the sun; left out"] and found.sun == pytest.approx(SUN, rel=0.01)
    with pytest.raises(InputError, match="no sunlit patch can be used: north does not face the sun; left out"):
        fit_daylight([patch("shadowed", SHADOWED)], [away], DOWN)


# ---- through the stages ------------------------------------------------------------------------

OPEN_AIR = """\
photograph: {file: photograph.exr}
camera: {horizontal_field_of_view: 60, pitch: 0, height: 1.6}
depth:
  sky_depth: 500
  refine: {radius: 0}
  regions:
    sky: {class: sky, pixels: [[0, 0], [96, 0], [96, 33], [0, 33]]}
    ground: {class: support, pixels: [[0, 33], [96, 33], [96, 64], [0, 64]]}
    house: {class: vertical, foot: [[60, 44], [96, 44]], pixels: [[60, 10], [96, 10], [96, 44], [60, 44]]}
lights:
  sky: {type: sky}
  sun: {type: sunlight, direction: [0.3, -0.7, -0.4]}
  ground: {type: ground}
illumination:
  type: liu_xing
  albedo: [0.20, 0.22, 0.18]
  shadowed:
    - {sky_visibility: 1, pixels: [[4, 48], [30, 48], [30, 62], [4, 62]]}
  sunlit:
    - {sky_visibility: 1, pixel: [70, 54], radius: 7}
fog: {type: homogeneous, visibility: 100}
"""
BEFORE = ("resolve", "photograph", "camera", "geometry", "sun_direction")


def picture():
    """Ground in the sun to the right and in the shade to the left, a sunlit house, a bright sky."""
    image = np.broadcast_to(SKY, (64, 96, 3)).copy()
    image[33:] = radiance()
    image[33:, :45] = radiance(sun=0)
    image[10:44, 60:] = radiance(WALL)
    return image.astype(np.float32)


@pytest.fixture
def open_air(tiny_scene):
    tiny_scene.file.write_text(OPEN_AIR)
    write_map(tiny_scene.folder / "photograph.exr", picture())
    return tiny_scene


def test_open_air_scene_gets_its_light_back(open_air):
    assert open_air.run(*BEFORE, "illumination") == 0
    found = read_json(open_air.build.illumination)
    lights = found["lights"]
    # exact but for the half floats of the photograph's file, 5e-4
    assert lights["sky"]["strength"] == pytest.approx(SKY, rel=2e-3)
    assert lights["sun"]["strength"] == pytest.approx(SUN, rel=2e-3)
    assert lights["sky"]["source"] == "liu_xing" and lights["sky"]["quantity"] == "radiance"
    assert lights["ground"]["source"] == "mean of the photograph's ground"
    assert found["sun_over_sky"] == pytest.approx(SUN.mean() / (np.pi * SKY.mean()), rel=2e-3)
    assert found["scale_source"] == "stated albedo" and found["messages"] == []
    assert found["patches"]["sunlit[0]"]["pixels"] == found["patches"]["sunlit[0]"]["outlined_pixels"] > 100


def test_wall_as_a_patch_takes_the_scenes_own_ground_light(open_air):
    """The house's normal comes from its foot line; the light from below is what the scene states."""
    open_air.replace("{sky_visibility: 1, pixel: [70, 54], radius: 7}", "{sky_visibility: 1, pixels: [[64, 14], [92, 14], [92, 40], [64, 40]], on: house}")
    open_air.replace("{type: ground}", f"{{type: ground, radiance: {GROUND.tolist()}}}")
    assert open_air.run(*BEFORE, "illumination") == 0
    lights = read_json(open_air.build.illumination)["lights"]
    assert lights["sun"]["strength"] == pytest.approx(SUN, rel=3e-3)
    assert lights["ground"]["source"] == "given"


def test_overcast_street(open_air, capsys):
    open_air.replace("  sun: {type: sunlight, direction: [0.3, -0.7, -0.4]}\n", "")
    assert open_air.run(*BEFORE, "illumination") == 0
    found = read_json(open_air.build.illumination)
    assert found["lights"]["sky"]["strength"] == pytest.approx(SKY, rel=2e-3) and found["sun_over_sky"] == 0
    assert "note: no light of type sunlight is to be estimated; the sunlit patches are not used" in capsys.readouterr().err


def test_a_given_sun_needs_no_sunlit_patches(open_air):
    open_air.replace("{type: sunlight, ", "{type: sunlight, irradiance: [1, 2, 3], ")
    open_air.replace("  sunlit:\n    - {sky_visibility: 1, pixel: [70, 54], radius: 7}\n", "")
    assert open_air.run(*BEFORE, "illumination") == 0
    lights = read_json(open_air.build.illumination)["lights"]
    assert lights["sun"]["strength"] == [1, 2, 3] and lights["sky"]["strength"] == pytest.approx(SKY, rel=2e-3)


def test_a_guessed_albedo_is_said(open_air):
    open_air.replace("  albedo: [0.20, 0.22, 0.18]\n", "")
    assert open_air.run(*BEFORE, "illumination") == 0
    found = read_json(open_air.build.illumination)
    assert found["scale_source"] == "guess" and "taken as 0.2" in found["messages"][0]
    assert found["lights"]["sky"]["strength"] == pytest.approx(SKY * ALBEDO / 0.2, rel=2e-3)
    open_air.replace("radius: 7}", "radius: 7, albedo: 0.2}")
    open_air.replace("[4, 62]]}", "[4, 62]], albedo: 0.2}")
    assert open_air.run(*BEFORE, "illumination") == 0
    assert read_json(open_air.build.illumination)["scale_source"] == "stated albedo"


def test_photograph_without_ground_has_no_ground_light(open_air):
    open_air.replace("class: support, ", "class: vertical, depth: 30, ")
    assert open_air.run(*BEFORE, "illumination") == 0
    found = read_json(open_air.build.illumination)
    assert found["lights"]["ground"]["strength"] == [0, 0, 0]
    assert "the photograph shows no ground, so ground is taken as 0; give it a 'radiance'" in found["messages"]


@pytest.mark.parametrize("old, new, at, says", [
    ("pixel: [70, 54], radius: 7}", "pixel: [300, 54]}", "sunlit:",
     "sunlit[0] covers no pixel of the photograph; give it in pixels of the photograph, 96 x 64"),
    ("[[4, 48], [30, 48], [30, 62], [4, 62]]", "[[-9, 48], [-5, 48], [-5, 62]]", "shadowed:",
     "shadowed[0] covers no pixel"),
    ("radius: 7", "radius: 7, on: hous", "sunlit:",
     "sunlit[0] lies on 'hous', which no region of one plane is; use one of ground, house (did you mean 'house'?)"),
    ("  sunlit:\n    - {sky_visibility: 1, pixel: [70, 54], radius: 7}\n", "", "illumination:", "sun, a sunlight, without sunlit patches"),
    ("[[4, 48], [30, 48], [30, 62], [4, 62]]", "[[4, 48], [5, 48], [5, 49]]", "illumination:",
     "no shadowed patch can be used: shadowed[0] has fewer than 9 pixels"),
    ("  ground: {type: ground}", "  ground: {type: ground}\n  more: {type: sky}", "illumination:",
     "liu_xing cannot tell sky and more apart, two lights of type sky"),
    ("  ground: {type: ground}", "  lamp: {type: lamps, positions: [{point: [0, 3, -9]}]}", "illumination:",
     "liu_xing cannot estimate lamp, a light of type lamps; give it a 'intensity'"),
    ("radius: 7", "radius: -7", "radius: -7", "illumination.sunlit.0.radius = -7"),
    ("pixel: [70, 54], radius: 7}", "radius: 7}", "radius: 7}", "illumination.sunlit.0: no place"),
    ("radius: 7", "radius: 7, pixels: [[1, 2], [3, 4], [5, 6]]", "radius: 7,",
     "both 'pixels' and 'pixel' are there"),
    ("[0.20, 0.22, 0.18]", "[0.20, 0.22, 1.8]", "albedo:", "illumination.albedo"),
    ("\n    - {sky_visibility: 1, pixels: [[4, 48], [30, 48], [30, 62], [4, 62]]}", " []", "shadowed:", "illumination.shadowed = []"),
], ids=["off the picture", "outline off the picture", "unknown region", "no sunlit patches", "few pixels", "two skies", "a lamp", "radius", "no place", "two places", "albedo",
        "nothing in the shade"])
def test_mistakes_are_one_line(open_air, capsys, old, new, at, says):
    open_air.replace(old, new)
    status = open_air.run(*BEFORE, "illumination")
    message = refusal(status, capsys.readouterr().err, open_air.root)
    assert message.startswith(f"{open_air.file}:{open_air.line(at)}: "), message
    assert says in message


def test_exchanged_patches_through_the_stages(open_air, capsys):
    open_air.replace("[[4, 48], [30, 48], [30, 62], [4, 62]]", "[[62, 48], [90, 48], [90, 62], [62, 62]]")
    open_air.replace("pixel: [70, 54], radius: 7}", "pixel: [20, 54], radius: 7}")
    message = refusal(open_air.run(*BEFORE, "illumination"), capsys.readouterr().err, open_air.root)
    assert message == (f"{open_air.file}:{open_air.line('illumination:')}: the sunlit patches are darker than the shadowed"
                       " ones; exchange them, or leave out the light of type sunlight under an overcast sky")


def test_both_patches_in_the_shade_through_the_stages(open_air, capsys):
    open_air.replace("pixel: [70, 54], radius: 7}", "pixel: [20, 54], radius: 7}")
    assert open_air.run(*BEFORE, "illumination") == 0
    assert "note: the sunlit patches are hardly brighter than the shadowed ones" in capsys.readouterr().err
    assert read_json(open_air.build.illumination)["lights"]["sun"]["strength"] == pytest.approx([0, 0, 0], abs=1e-5)


def test_bulbs_in_the_photograph_are_no_surfaces(open_air):
    """A bulb of a thousand times white over the street, which would make what surfaces throw back brighter than white."""
    image = picture()
    image[38:41, 20:23] = 1000
    write_map(open_air.folder / "photograph.exr", image)
    open_air.replace("  ground: {type: ground}\n", "  ground: {type: ambient}\n"
                     "  lamp: {type: lamps, intensity: [5, 5, 5], radius: 0.05, positions: [{pixel: [21.5, 39.5], depth: 8}]}\n")
    assert open_air.run(*BEFORE, "illumination") == 0
    surfaces = picture()[33:]  # and the house above the horizon, of the same brightness within a third
    assert read_json(open_air.build.illumination)["lights"]["ground"]["strength"] == pytest.approx(
        surfaces.mean((0, 1)), rel=0.35)
