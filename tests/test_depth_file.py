"""Depth maps and painted label images, written to real files and read back at the photograph's size."""

import imagecodecs
import numpy as np
import OpenImageIO as oiio
import pytest

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, from_field_of_view
from pipeline.imaging.depth_file import read_depth, read_labels

VIEW = from_field_of_view(64, 48, 60, camera_height=1.5, pitch=-8, principal_point=(33.0, 22.5))
RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)
PALETTE = ["#ff0000", "#00ff00", "#0000ff"]


def planar_over_radial(view: Camera, size: tuple[int, int] | None = None) -> np.ndarray:
    u, v = np.moveaxis((centres(view, size) - view.principal_point) / view.focal_length, -1, 0)
    return 1 / np.sqrt(1 + u**2 + v**2)


def slanted(view: Camera, size: tuple[int, int] | None = None) -> np.ndarray:
    """Radial depth [m] of a wall that runs into the distance."""
    normal = np.array([0.8, 0.1, 0.6])
    return 6 / np.abs(view.directions(centres(view, size)) @ (normal / np.linalg.norm(normal)))


def centres(view: Camera, size: tuple[int, int] | None) -> np.ndarray:
    """Centres [pixel] of the photograph's pixels, or of those of a map of another size over all of it."""
    width, height = size or (view.width, view.height)
    v, u = np.mgrid[:height, :width] + 0.5
    return np.stack([u * view.width / width, v * view.height / height], -1)


def of_map(width: int, height: int, focal_length: float, principal_point) -> Camera:
    """A map's own camera, beside VIEW."""
    return Camera(width, height, focal_length, np.array(principal_point), VIEW.world_from_camera, VIEW.position)


def png(path, codes):
    path.write_bytes(imagecodecs.png_encode(np.ascontiguousarray(codes)))
    return path


def picture(path, values, kind="float", names=None, display=None, alpha=-1):
    """Any file by OpenImageIO; display: (x, y, width, height) round it."""
    values = np.asarray(values)
    values = values[..., None] if values.ndim == 2 else values
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
    if names:
        spec.channelnames = names
    if display:
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = display
    spec.alpha_channel = alpha
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(np.ascontiguousarray(values)) and output.close()
    return path


# ---- depth ------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("kind", ["planar", "radial"])
def test_png_holds_millimetres(kind, tmp_path):
    radial = slanted(VIEW)
    stored = radial * planar_over_radial(VIEW) if kind == "planar" else radial
    path = png(tmp_path / "d.png", np.round(1000 * stored).astype(np.uint16))
    found = read_depth(path, VIEW, kind=kind)
    assert stored.max() < 65  # metres; what 16 bits hold
    np.testing.assert_allclose(found, radial, atol=0.5e-3 * (radial / stored).max())  # half a millimetre of rounding
    scaled = read_depth(path, VIEW, kind=kind, metres_per_unit=0.25)
    np.testing.assert_allclose(scaled, 250 * found, rtol=1e-12)


@pytest.mark.parametrize("kind, sample, error", [("planar", "float", 1e-6), ("radial", "float", 1e-6),
                                                 ("planar", "half", 1e-3)])  # half a unit in the last place
def test_exr_holds_metres(kind, sample, error, tmp_path):
    radial = 100 * slanted(VIEW)
    stored = radial * planar_over_radial(VIEW) if kind == "planar" else radial
    path = picture(tmp_path / "d.exr", stored.astype(np.float32), sample)
    np.testing.assert_allclose(read_depth(path, VIEW, kind=kind), radial, rtol=error)


def test_disparity_with_baseline(tmp_path):
    planar = slanted(VIEW) * planar_over_radial(VIEW)
    path = picture(tmp_path / "d.exr", (VIEW.focal_length * 0.2 / planar).astype(np.float32))
    np.testing.assert_allclose(read_depth(path, VIEW, kind="disparity", baseline=0.2), slanted(VIEW), rtol=1e-6)
    # at half the size the same scene has half the disparity, in pixels
    disparity = 0.5 * VIEW.focal_length * 0.2 / (slanted(VIEW, (32, 24)) * planar_over_radial(VIEW, (32, 24)))
    found = read_depth(picture(tmp_path / "h.exr", disparity.astype(np.float32)), VIEW, kind="disparity", baseline=0.2)
    np.testing.assert_allclose(found, slanted(VIEW), rtol=1e-5)
    whole = read_depth(png(tmp_path / "d.png", np.full((48, 64), 8, np.uint8)), VIEW, kind="disparity", baseline=0.2)
    assert whole.min() == pytest.approx(VIEW.focal_length * 0.2 / 8, rel=1e-3)


@pytest.mark.parametrize("size", [(32, 24), (128, 96), (200, 150), (21, 16)])
@pytest.mark.parametrize("kind", ["planar", "radial"])
def test_other_sizes_see_the_same_wall(size, kind, tmp_path):
    values = slanted(VIEW, size) * (planar_over_radial(VIEW, size) if kind == "planar" else 1)
    found = read_depth(picture(tmp_path / "d.exr", values.astype(np.float32)), VIEW, kind=kind)
    # between pixels the inverse is interpolated, which is exact on a plane; rounding of 32 bits, amplified by the slant
    np.testing.assert_allclose(found, slanted(VIEW), rtol=1e-5)


def test_own_intrinsics(tmp_path):
    # a wider lens, off centre, of another shape
    own = of_map(100, 60, focal_length=40.0, principal_point=(47.0, 31.0))
    path = picture(tmp_path / "d.exr", (slanted(own) * planar_over_radial(own)).astype(np.float32))
    found = read_depth(path, VIEW, kind="planar", focal_length=40.0, principal_point=[47.0, 31.0])
    np.testing.assert_allclose(found, slanted(VIEW), rtol=1e-5)
    # a longer lens sees less: nothing is known outside
    own = of_map(80, 80, focal_length=150.0, principal_point=(40.0, 40.0))
    path = picture(tmp_path / "long.exr", (slanted(own) * planar_over_radial(own)).astype(np.float32))
    found = read_depth(path, VIEW, kind="planar", focal_length=150.0, principal_point=[40.0, 40.0])
    rays = (VIEW.pixel_centres() - VIEW.principal_point) / VIEW.focal_length * 150 + 40
    np.testing.assert_array_equal(np.isfinite(found), ((rays >= 0) & (rays <= 80)).all(-1))
    assert 0.05 < np.isfinite(found).mean() < 0.95


def test_own_focal_length_keeps_the_middle_of_the_map(tmp_path):
    centred = from_field_of_view(64, 48, 60)
    own = Camera(90, 50, 70.0, np.array([45.0, 25.0]), centred.world_from_camera, centred.position)
    path = picture(tmp_path / "d.exr", (slanted(own) * planar_over_radial(own)).astype(np.float32))
    found = read_depth(path, centred, kind="planar", focal_length=70.0)
    inside = np.isfinite(found)
    assert inside.mean() > 0.8
    np.testing.assert_allclose(found[inside], slanted(centred)[inside], rtol=1e-5)


def test_unknown_values_stay_unknown(tmp_path):
    values = np.full((48, 64), 5.0, np.float32)
    odd = {(3, 4): 0.0, (10, 11): -2.0, (20, 21): np.nan, (30, 31): np.inf, (40, 41): -np.inf}
    for where, value in odd.items():
        values[where] = value
    found = read_depth(picture(tmp_path / "d.exr", values), VIEW, kind="radial")
    assert {tuple(where) for where in np.argwhere(np.isnan(found)).tolist()} == set(odd)
    np.testing.assert_allclose(found[np.isfinite(found)], 5, rtol=1e-6)
    codes = np.full((96, 128), 5000, np.uint16)
    codes[40:60, 40:60] = 0
    found = read_depth(png(tmp_path / "d.png", codes), VIEW, kind="radial")
    assert np.isnan(found[21:29, 21:29]).all() and np.isfinite(found[:19]).all()


@pytest.mark.parametrize("size", [(32, 24), (64, 48), (150, 113)])
def test_things_before_others_stay_sharp(size, tmp_path):
    near = np.zeros((size[1], size[0]), bool)
    near[:, size[0] // 3:size[0] // 2] = True
    found = read_depth(picture(tmp_path / "d.exr", np.where(near, 3.0, 80.0).astype(np.float32)), VIEW, kind="radial")
    assert ((np.abs(found / 3 - 1) < 0.01) | (np.abs(found / 80 - 1) < 0.01)).all()  # and nothing between
    assert 0.1 < (found < 4).mean() < 0.25


@pytest.mark.parametrize("values, names, message", [
    (np.zeros((48, 64)), None, "holds no depth above 0; check its unit and kind"),
    (np.full((48, 64), np.nan), None, "holds no depth above 0"),
    (np.ones((48, 40)), None, "40x48 values have another shape than the photograph's 64x48; give the map's own"),
    (np.random.default_rng(0).uniform(1, 2, (48, 64, 3)), None, "channels R, G, B, which differ; give a file of one"),
])
def test_maps_that_are_none(values, names, message, tmp_path):
    path = picture(tmp_path / "d.exr", values.astype(np.float32), names=names)
    with pytest.raises(InputError, match=message) as error:
        read_depth(path, VIEW, kind="planar")
    assert error.value.place == str(path)


def test_eight_bits_are_too_few_for_millimetres(tmp_path):
    path = png(tmp_path / "d.png", np.full((48, 64), 200, np.uint8))
    with pytest.raises(InputError, match="8 bits a value.*0.255 m; give 'metres_per_unit'"):
        read_depth(path, VIEW, kind="radial")
    np.testing.assert_allclose(read_depth(path, VIEW, kind="radial", metres_per_unit=0.5), 100)


def test_the_channel_that_holds_depth(tmp_path):
    rng = np.random.default_rng(0)
    layers = np.concatenate([rng.uniform(size=(48, 64, 3)), np.full((48, 64, 1), 7.0)], -1).astype(np.float32)
    path = picture(tmp_path / "layers.exr", layers, names=("R", "G", "B", "ViewLayer.Depth.Z"))
    np.testing.assert_allclose(read_depth(path, VIEW, kind="radial"), 7, rtol=1e-6)
    grey = np.repeat(np.full((48, 64, 1), 7000, np.uint16), 3, -1)
    np.testing.assert_allclose(read_depth(png(tmp_path / "grey.png", grey), VIEW, kind="radial"), 7)
    path = picture(tmp_path / "d.tif", np.full((48, 64), 7000, np.uint16), "uint16")
    np.testing.assert_allclose(read_depth(path, VIEW, kind="radial"), 7)


def test_transparent_values_are_unknown_and_others_are_not_dimmed(tmp_path):
    codes = np.stack([np.full((48, 64), 9000), np.full((48, 64), 40000)], -1).astype(np.uint16)
    codes[:, :5, 1] = 0
    found = read_depth(png(tmp_path / "d.png", codes), VIEW, kind="radial")
    assert np.isnan(found[:, :5]).all()
    np.testing.assert_allclose(found[:, 5:], 9)


def test_a_cropped_render_knows_nothing_outside(tmp_path):
    path = picture(tmp_path / "d.exr", np.full((20, 30), 4.0, np.float32), display=(-10, -8, 64, 48))
    found = read_depth(path, VIEW, kind="radial")
    assert np.isfinite(found).sum() == 600 and np.isfinite(found[8:28, 10:40]).all()


@pytest.mark.parametrize("place", [(0, 100), (0, -100), (100, 0), (-100, 0)])
def test_a_file_that_lies_beside_its_picture_knows_nothing(place, tmp_path):
    path = picture(tmp_path / "d.exr", np.full((20, 30), 4.0, np.float32), display=(*place, 64, 48))
    with pytest.raises(InputError, match="holds no depth above 0"):
        read_depth(path, VIEW, kind="radial")


DAMAGE = [("cut off", lambda data: data[:len(data) // 2], "is damaged"),
          ("empty", lambda data: b"", "cannot be read as a picture"),
          ("text", lambda data: b"no picture", "cannot be read as a picture")]


@pytest.mark.parametrize("suffix", [".png", ".exr"])
@pytest.mark.parametrize("id, damage, message", DAMAGE, ids=[one[0] for one in DAMAGE])
def test_damaged_files(suffix, id, damage, message, tmp_path):
    path = tmp_path / f"d{suffix}"
    noise = np.random.default_rng(0).integers(1, 60000, (48, 64))
    png(path, noise.astype(np.uint16)) if suffix == ".png" else picture(path, noise.astype(np.float32))
    path.write_bytes(damage(path.read_bytes()))
    for read in (lambda: read_depth(path, VIEW, kind="planar"), lambda: read_labels(path, 64, 48, PALETTE)):
        with pytest.raises(InputError, match=message) as error:
            read()
        assert error.value.place == str(path) and "\n" not in str(error.value)


def test_a_label_image_whose_end_is_missing(tmp_path):
    path = tmp_path / "l.jpg"
    data = imagecodecs.jpeg_encode(np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8))
    path.write_bytes(data[:len(data) // 2])  # decoders give what there is, and grey below
    with pytest.raises(InputError, match="l.jpg: is damaged"):
        read_labels(path, 64, 48, PALETTE)


def test_too_large_a_file_is_refused_by_its_header(tmp_path, monkeypatch):
    path = png(tmp_path / "d.png", np.full((48, 64), 4000, np.uint16))
    monkeypatch.setattr("pipeline.imaging.depth_file.MAX_PIXELS", 3000)
    with pytest.raises(InputError, match="has 64x48 pixels; keep it below"):
        read_depth(path, VIEW, kind="planar")


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1)])
def test_maps_of_few_pixels(size, tmp_path):
    view = from_field_of_view(*size, 60)
    path = picture(tmp_path / "d.exr", np.full(size[::-1], 3.0, np.float32))
    np.testing.assert_allclose(read_depth(path, view, kind="radial"), 3, rtol=1e-6)


def test_blocks_of_rows_are_no_seams(tmp_path, monkeypatch):
    path = picture(tmp_path / "d.exr", slanted(VIEW, (40, 30)).astype(np.float32))
    whole = read_depth(path, VIEW, kind="radial")
    monkeypatch.setattr("pipeline.imaging.depth_file._BLOCK", 100)
    np.testing.assert_array_equal(read_depth(path, VIEW, kind="radial"), whole)


# ---- labels -----------------------------------------------------------------------------------------------------

def painting(width=64, height=48, *, smooth=1) -> np.ndarray:
    """Sky above ground with a round red thing on it; smooth: samples a pixel and direction."""
    v, u = (np.mgrid[:height * smooth, :width * smooth] + 0.5) * (64 / width / smooth)
    codes = np.where((v < 24)[..., None], BLUE, GREEN)
    codes = np.where((np.hypot(u - 30, v - 24) < 12)[..., None], RED, codes)
    return codes.reshape(height, smooth, width, smooth, 3).mean((1, 3)).round().astype(np.uint8)


EXPECTED = np.array([0, 2, 1])[np.argmax([(painting() == colour).all(-1) for colour in (RED, BLUE, GREEN)], 0)]


def test_labels_are_the_palettes(tmp_path):
    labels = read_labels(png(tmp_path / "l.png", painting()), 64, 48, PALETTE)
    np.testing.assert_array_equal(labels, EXPECTED)


def test_smoothed_strokes_have_no_third_colour_between(tmp_path):
    # between red and blue lies the purple of a third thing, between blue and green the cyan of a fourth
    palette = [*PALETTE, "#800080", "#008080", "#808000"]
    labels = read_labels(png(tmp_path / "l.png", painting(smooth=5)), 64, 48, palette)
    assert (labels <= 2).all()
    assert (labels == EXPECTED).mean() > 0.98 and (labels != EXPECTED).any()


@pytest.mark.parametrize("size", [(128, 96), (32, 24), (200, 150), (63, 47)])
def test_labels_of_another_size(size, tmp_path):
    labels = read_labels(png(tmp_path / "l.png", painting(*size, smooth=3)), 64, 48, PALETTE)
    # up to a pixel of the coarser of the two along the borders, 24 + 75 pixels long
    assert (labels != EXPECTED).sum() <= 100 * max(64 / size[0], 1)
    # and without drift to one side, but for smoothed pixels just between two others
    rows, columns = np.nonzero(labels == 0)
    assert max(abs(columns.mean() + 0.5 - 30), abs(rows.mean() + 0.5 - 24)) < 0.6 * max(64 / size[0], 1)


def test_labels_in_other_kinds_of_files(tmp_path):
    opaque = np.concatenate([painting(), np.full((48, 64, 1), 255, np.uint8)], -1)
    for path in (png(tmp_path / "alpha.png", opaque), png(tmp_path / "deep.png", painting().astype(np.uint16) * 257),
                 picture(tmp_path / "l.tif", painting(), "uint8"),
                 picture(tmp_path / "l.exr", (painting() / 255).astype(np.float32))):
        np.testing.assert_array_equal(read_labels(path, 64, 48, PALETTE), EXPECTED, err_msg=path.name)


@pytest.mark.parametrize("channels", [1, 2], ids=["grey", "grey and alpha"])
def test_grey_labels(channels, tmp_path):
    codes = np.where(EXPECTED == 0, 0, np.where(EXPECTED == 1, 128, 255)).astype(np.uint8)
    codes = codes if channels == 1 else np.stack([codes, np.full_like(codes, 255)], -1)
    labels = read_labels(png(tmp_path / "l.png", codes), 64, 48, ["#000000", "#808080", "#ffffff"])
    np.testing.assert_array_equal(labels, EXPECTED)


def test_what_is_not_painted_is_no_label(tmp_path):
    codes = np.concatenate([painting(), np.full((48, 64, 1), 255, np.uint8)], -1)
    codes[:, 50:, 3] = 0
    labels = read_labels(png(tmp_path / "clear.png", codes), 64, 48, PALETTE)
    # the border that programs smooth is taken for painted
    assert (labels[:, 54:] == -1).all() and (labels[:, :50] == EXPECTED[:, :50]).all()
    codes = painting()
    codes[:, 50:] = 255  # white is as far from all three
    labels = read_labels(png(tmp_path / "white.png", codes), 64, 48, PALETTE)
    assert (labels[:, 54:] == -1).all() and (labels[:, :50] == EXPECTED[:, :50]).all()


def test_colours_by_a_less_exact_hand(tmp_path):
    codes = np.where((EXPECTED == 0)[..., None], (237, 28, 36), np.where((EXPECTED == 1)[..., None], (34, 177, 76),
                                                                         (63, 72, 204))).astype(np.uint8)
    np.testing.assert_array_equal(read_labels(png(tmp_path / "l.png", codes), 64, 48, PALETTE), EXPECTED)


def test_labels_of_another_shape(tmp_path):
    path = png(tmp_path / "l.png", painting()[:, :40])
    with pytest.raises(InputError, match="40x48 pixels have another shape than the photograph's 64x48; paint over"):
        read_labels(path, 64, 48, PALETTE)
