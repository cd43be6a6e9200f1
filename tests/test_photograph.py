"""Photographs in and out: exact round trips, orientation, colour, metadata, refusals."""

from __future__ import annotations

import resource

import imagecodecs
import numpy as np
import OpenImageIO as oiio
import pytest

from pipeline.errors import InputError
from pipeline.imaging.colour import linear_to_srgb, srgb_to_linear
from pipeline.imaging.photograph import (
    encode, read, read_exif_focal_length, write, write_png, write_unchanged)


def store(path, values, *, alpha=None, sample_type=None, **attributes):
    """Writes `values` (H, W, n) without this project's code; attributes as OpenImageIO names them."""
    values = np.asarray(values)
    sample_type = sample_type or ("float" if values.dtype == np.float32 else values.dtype.name)
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, sample_type)
    if alpha:
        spec.channelnames = ("Y", "A") if values.shape[2] == 2 else ("R", "G", "B", "A")
        spec.alpha_channel = values.shape[2] - 1
        if alpha == "straight":
            spec.attribute("oiio:UnassociatedAlpha", 1)
    for name, value in attributes.items():
        name = name.replace("__", ":")
        if isinstance(value, bytes):
            spec.attribute(name, oiio.TypeDesc(f"uint8[{len(value)}]"), np.frombuffer(value, np.uint8))
        elif isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), np.array(value, np.float32))
        else:
            spec.attribute(name, value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(np.ascontiguousarray(values)) and output.close()
    return path


def stored(path):
    """Raw values of a file as OpenImageIO gives them, alpha left alone."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    spec = source.spec()
    values = source.read_image(0, 0, 0, spec.nchannels, spec.format)
    return values.reshape(spec.height, spec.width, spec.nchannels), spec


def random_codes(height, width, channels, dtype=np.uint8):
    shape, top = (height, width, channels), np.iinfo(dtype).max
    return np.random.default_rng(1).integers(0, top, shape, dtype, endpoint=True)


def values_for(name, height, width):
    """Something that the kind of file called `name` can hold."""
    if name.endswith((".exr", ".hdr")):
        return np.random.default_rng(4).random((height, width, 3)).astype(np.float32)
    return random_codes(height, width, 3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_every_srgb_code_survives_decoding_and_encoding(tmp_path, dtype):
    codes = np.arange(np.iinfo(dtype).max + 1, dtype=dtype).reshape(-1, 256, 1).repeat(3, 2)
    codes[..., 1] = codes[::-1, ::-1, 1]  # otherwise the picture is grey
    photograph = read(store(tmp_path / "all.png", codes))
    assert np.array_equal(encode(photograph.radiance, photograph), codes)


def test_srgb_matches_the_standard():
    # IEC 61966-2-1: the linear branch ends at 0.04045; mid grey 0.5 decodes to 0.21404 (published value).
    published = [0, 0.0031308, 0.2140411, 1]  # printed to seven places
    assert srgb_to_linear(np.array([0, 0.04045, 0.5, 1.0])) == pytest.approx(published, abs=1e-6)
    beyond = np.array([-0.3, 1e-9, 7.0])
    assert linear_to_srgb(srgb_to_linear(beyond)) == pytest.approx(beyond, rel=1e-12)  # float64 rounding


@pytest.mark.parametrize("name, dtype", [("p.png", np.uint8), ("p.png", np.uint16), ("p.tif", np.uint8),
                                         ("p.tif", np.uint16)])
def test_a_changed_photograph_keeps_kind_and_depth(tmp_path, name, dtype):
    codes = random_codes(9, 7, 3, dtype)
    photograph = read(store(tmp_path / name, codes))
    write(tmp_path / f"fog_{name}", photograph.radiance * 0.5, photograph)
    values, _ = stored(tmp_path / f"fog_{name}")
    top = np.iinfo(dtype).max
    expected = np.rint(linear_to_srgb(0.5 * srgb_to_linear(codes / top)) * top)
    assert values.dtype == dtype
    assert np.abs(values - expected).max() <= 1  # float32 against float64 may round the other way


def test_a_jpeg_stays_a_jpeg_without_chroma_subsampling(tmp_path):
    ramp = np.linspace(0, 255, 64).astype(np.uint8)[None, :, None]
    codes = np.concatenate([ramp, ramp[:, ::-1], ramp // 2], 2).repeat(16, 0)
    photograph = read(store(tmp_path / "p.jpg", codes, compression="jpeg:100"))
    write(tmp_path / "fog.jpg", photograph.radiance, photograph)
    values, spec = stored(tmp_path / "fog.jpg")
    assert spec.get_string_attribute("jpeg:subsampling") == "4:4:4"
    # Quality 95 quantises smooth blocks by a few codes; quality 75 or 4:2:0 loses more on this ramp.
    assert np.abs(values.astype(int) - photograph.codes).max() <= 6


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_applied_once(tmp_path, orientation):
    corners = np.zeros((2, 3, 3), np.uint8)
    corners[0, 0], corners[0, 2], corners[1, 0] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    photograph = read(store(tmp_path / "p.png", corners, Orientation=orientation))
    # EXIF 2.32, tag 274: where the stored first row and first column belong in the upright picture.
    red, green, blue = {1: ("tl", "tr", "bl"), 2: ("tr", "tl", "br"), 3: ("br", "bl", "tr"),
                        4: ("bl", "br", "tl"), 5: ("tl", "bl", "tr"), 6: ("tr", "br", "tl"),
                        7: ("br", "tr", "bl"), 8: ("bl", "tl", "br")}[orientation]
    place = {"tl": (0, 0), "tr": (0, -1), "bl": (-1, 0), "br": (-1, -1)}
    for channel, corner in enumerate((red, green, blue)):
        assert photograph.radiance[place[corner]].tolist() == np.eye(3)[channel].tolist()
    write(tmp_path / "again.png", photograph.radiance, photograph)
    again = read(tmp_path / "again.png")
    assert np.array_equal(again.codes, photograph.codes)
    assert again.header.get_int_attribute("Orientation", 1) == 1


@pytest.mark.parametrize("orientation", [1, 6])
def test_without_fog_the_file_comes_back_byte_for_byte(tmp_path, orientation):
    original = store(tmp_path / "p.jpg", random_codes(16, 24, 3), Orientation=orientation)
    photograph = read(original)
    write_unchanged(tmp_path / "same.jpg", photograph)
    write_unchanged(tmp_path / "same.png", photograph)
    assert (tmp_path / "same.jpg").read_bytes() == original.read_bytes()
    assert np.array_equal(stored(tmp_path / "same.png")[0], photograph.codes)
    assert photograph.codes.shape == ((16, 24, 3) if orientation == 1 else (24, 16, 3))


def test_alpha_neither_darkens_nor_changes(tmp_path):
    codes = random_codes(6, 5, 4)
    photograph = read(store(tmp_path / "p.png", codes, alpha="straight"))
    write(tmp_path / "fog.png", photograph.radiance + 0.1, photograph)
    assert np.array_equal(encode(photograph.radiance, photograph), codes)
    assert np.array_equal(stored(tmp_path / "fog.png")[0][..., 3], codes[..., 3])
    assert photograph.alpha == pytest.approx(codes[..., 3] / 255.0)


def test_exr_colours_are_freed_from_their_alpha_and_bound_again(tmp_path):
    codes = np.array([[[0.2, 0.4, 0.6, 0.5], [0.1, 0.2, 0.3, 0.0]]], np.float32)
    photograph = read(store(tmp_path / "p.exr", codes, alpha="associated"))
    assert photograph.radiance[0, 0] == pytest.approx([0.4, 0.8, 1.2])
    assert np.isfinite(photograph.radiance).all()
    assert encode(photograph.radiance, photograph) == pytest.approx(codes)


@pytest.mark.parametrize("channels", [1, 2])
def test_grey_stays_grey_until_the_fog_has_colour(tmp_path, channels):
    codes = random_codes(6, 5, channels)
    photograph = read(store(tmp_path / "p.png", codes, alpha="straight" if channels == 2 else None))
    assert photograph.is_grey and np.array_equal(photograph.radiance[..., 0], photograph.radiance[..., 2])
    assert np.array_equal(encode(photograph.radiance, photograph), codes)
    tinted = photograph.radiance * [1, 0.9, 0.8]
    write(tmp_path / "fog.png", tinted, photograph)
    values, _ = stored(tmp_path / "fog.png")
    assert values.shape == (6, 5, channels + 2)
    assert np.abs(values[..., :3] / 255 - linear_to_srgb(tinted)).max() < 0.51 / 255  # rounding to codes


def test_a_palette_is_read_as_its_colours(tmp_path):
    cv2 = pytest.importorskip("cv2")
    palette = np.array([[[10, 200, 30], [250, 5, 90]]], np.uint8)
    path = tmp_path / "p.png"
    assert cv2.imwrite(str(path), palette[..., ::-1].repeat(4, 0), [cv2.IMWRITE_PNG_BILEVEL, 0])
    assert np.array_equal(read(path).codes, palette.repeat(4, 0))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_wide_gamut_is_read_without_clipping_and_written_in_its_own_profile(tmp_path, dtype):
    profile = imagecodecs.cms_profile("adobergb")
    top = np.iinfo(dtype).max
    codes = random_codes(8, 8, 3, dtype)
    codes[0, 0] = (0, top, 0)
    photograph = read(store(tmp_path / "p.tif", codes, ICCProfile=profile))
    # Adobe RGB's green primary in Rec.709 from the two standards' chromaticities.
    assert photograph.radiance[0, 0] == pytest.approx([-0.3984, 1.0, -0.0429], abs=2e-3)
    write(tmp_path / "fog.tif", photograph.radiance, photograph)
    values, spec = stored(tmp_path / "fog.tif")
    assert np.asarray(spec.getattribute("ICCProfile"), np.uint8).tobytes() == profile
    # A channel of code 0 beside a full one is a difference of float32 numbers near 1, to the power
    # 1/2.2: 1e-7 ** 0.45 = 7e-4 of the range. No 8-bit code changes.
    assert np.abs(values.astype(int) - codes).max() <= (0 if dtype == np.uint8 else 7e-4 * top)


def test_an_embedded_srgb_profile_is_exact_and_embedded_again(tmp_path):
    profile = imagecodecs.cms_profile("srgb")
    codes = random_codes(32, 32, 3, np.uint16)
    photograph = read(store(tmp_path / "p.png", codes, ICCProfile=profile))
    assert np.array_equal(encode(photograph.radiance, photograph), codes)
    write(tmp_path / "fog.png", photograph.radiance * 0.5, photograph)
    _, spec = stored(tmp_path / "fog.png")
    assert np.asarray(spec.getattribute("ICCProfile"), np.uint8).tobytes() == profile


def test_a_grey_profile_holds_until_the_fog_has_colour(tmp_path):
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
    profile = imagecodecs.cms_profile("gray", gamma=1.8)
    photograph = read(store(tmp_path / "p.tif", codes, ICCProfile=profile))
    # Adaptation from D50 to D65 by the profile's 16-bit fixed-point numbers rounds to a few 1e-5.
    assert photograph.radiance[..., 1] == pytest.approx((codes[..., 0] / 255) ** 1.8, abs=1e-4)
    assert np.array_equal(encode(photograph.radiance, photograph), codes)
    write(tmp_path / "fog.tif", photograph.radiance * [1, 0.9, 0.8], photograph)
    values, spec = stored(tmp_path / "fog.tif")
    assert values.shape[2] == 3 and spec.getattribute("ICCProfile") is None


def test_chromaticities_of_an_exr_are_honoured(tmp_path):
    rec2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    values = np.array([[[1, 0, 0], [1, 1, 1]]], np.float32)
    photograph = read(store(tmp_path / "p.exr", values, chromaticities=rec2020))
    # ITU-R BT.2087: linear BT.2020 red in BT.709.
    assert photograph.radiance[0, 0] == pytest.approx([1.6605, -0.1246, -0.0182], abs=1e-3)
    assert photograph.radiance[0, 1] == pytest.approx([1, 1, 1], abs=1e-3)
    assert encode(photograph.radiance, photograph) == pytest.approx(values, abs=1e-3)


def test_colour_space_can_be_named(tmp_path):
    path = store(tmp_path / "p.png", np.full((1, 1, 3), 128, np.uint8))
    assert read(path, "linear").radiance == pytest.approx(128 / 255)
    assert read(path).radiance == pytest.approx(float(srgb_to_linear(128 / 255)))
    green = store(tmp_path / "g.png", np.array([[[0, 255, 0]]], np.uint8))
    # P3 green in Rec.709, from the chromaticities.
    assert read(green, "display_p3").radiance[0, 0, 0] == pytest.approx(-0.2249, abs=1e-3)
    assert read(green, "adobe_rgb").radiance[0, 0, 0] == pytest.approx(-0.3984, abs=2e-3)
    with pytest.raises(InputError, match=r"p\.png: unknown colour_space 'rec601'; use one of auto, srgb"):
        read(path, "rec601")


@pytest.mark.parametrize("name, sample_type", [("p.exr", "half"), ("p.exr", "float"), ("p.tif", "float")])
def test_float_stays_float_and_nan_does_not_spread(tmp_path, name, sample_type):
    values = np.random.default_rng(2).random((5, 6, 3)).astype(np.float16).astype(np.float32) * 8
    values[1, 2, 0], values[3, 3, 1] = np.nan, np.inf
    photograph = read(store(tmp_path / name, values, sample_type=sample_type))
    assert np.argwhere(photograph.clipped).tolist() == [[1, 2], [3, 3]]
    assert not photograph.radiance[photograph.clipped].any()
    assert np.array_equal(photograph.radiance[~photograph.clipped], values[~photograph.clipped])
    write(tmp_path / f"fog_{name}", photograph.radiance + 1e6 * (sample_type == "half"), photograph)
    again, spec = stored(tmp_path / f"fog_{name}")
    assert str(spec.format) == sample_type and np.isfinite(again.astype(np.float32)).all()


def test_radiance_files_round_trip_to_their_shared_exponent(tmp_path):
    values = np.random.default_rng(3).random((9, 16, 3)).astype(np.float32) * 100
    photograph = read(store(tmp_path / "p.hdr", values))
    write(tmp_path / "fog.hdr", photograph.radiance, photograph)
    # 8-bit mantissas relative to the pixel's largest channel: stored twice, at most one step of 1/128.
    step = photograph.radiance.max(-1, keepdims=True) / 128
    assert (np.abs(read(tmp_path / "fog.hdr").radiance - photograph.radiance) <= step).all()


def test_a_png_that_declares_gamma_1_is_linear(tmp_path):
    path = store(tmp_path / "p.png", np.full((2, 2, 3), 128, np.uint8), oiio__ColorSpace="lin_rec709_scene")
    assert read(path).radiance == pytest.approx(128 / 255)


def test_clipped_marks_the_top_code_in_any_channel(tmp_path):
    codes = np.full((1, 3, 3), 254, np.uint8)
    codes[0, 1, 2] = 255
    assert read(store(tmp_path / "p.png", codes)).clipped.tolist() == [[False, True, False]]


def test_metadata_stays_with_the_photograph(tmp_path):
    path = store(tmp_path / "p.jpg", random_codes(8, 8, 3), Make="Acme", Model="One", ExposureTime=0.01,
                 DateTime="2020:01:02 03:04:05", Copyright="A. Person", Exif__FocalLength=35.0, Orientation=6)
    photograph = read(path)
    write(tmp_path / "fog.jpg", photograph.radiance, photograph)
    _, spec = stored(tmp_path / "fog.jpg")
    for name in ("Make", "Model", "ExposureTime", "DateTime", "Copyright", "Exif:FocalLength"):
        assert spec.getattribute(name) == photograph.header.getattribute(name) is not None, name
    assert spec.get_int_attribute("Orientation") == 1


def test_write_png_has_the_depth_of_the_photograph(tmp_path):
    eight = read(store(tmp_path / "p.jpg", random_codes(8, 8, 3)))
    floating = read(store(tmp_path / "p.exr", np.full((4, 4, 3), 2.0, np.float32)))
    write_png(tmp_path / "eight.png", eight.radiance, eight)
    write_png(tmp_path / "sixteen.png", floating.radiance / 4, floating)
    assert np.array_equal(stored(tmp_path / "eight.png")[0], eight.codes)
    values, _ = stored(tmp_path / "sixteen.png")
    assert values.dtype == np.uint16
    assert (values == round(float(linear_to_srgb(0.5)) * 65535)).all()


@pytest.mark.parametrize("height, width", [(1, 1), (1, 17), (17, 1)])
@pytest.mark.parametrize("name", ["p.jpg", "p.png", "p.tif", "p.exr", "p.hdr"])
def test_the_smallest_photographs(tmp_path, name, height, width):
    photograph = read(store(tmp_path / name, values_for(name, height, width)))
    write(tmp_path / f"fog_{name}", photograph.radiance, photograph)
    assert read(tmp_path / f"fog_{name}").radiance.shape == (height, width, 3)
    assert photograph.alpha is None and photograph.clipped.shape == (height, width)


@pytest.mark.parametrize("name", ["p.jpg", "p.png", "p.tif", "p.exr", "p.hdr"])
@pytest.mark.parametrize("fraction", [0.5, 0.95])
def test_a_truncated_file_is_refused(tmp_path, name, fraction):
    path = store(tmp_path / name, values_for(name, 64, 48))
    data = path.read_bytes()
    path.write_bytes(data[:int(len(data) * fraction)])
    with pytest.raises(InputError, match="truncated or damaged|not a readable image") as caught:
        read(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_what_is_no_photograph_is_refused(tmp_path):
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "text.png").write_text("not an image " * 20)
    bitmap = store(tmp_path / "p.bmp", random_codes(4, 4, 3))
    for path, message in [(tmp_path / "none.jpg", "no such file"), (tmp_path, "is a folder"),
                          (tmp_path / "empty.jpg", "the file is empty"),
                          (tmp_path / "text.png", "not a readable image"),
                          (bitmap, "a bmp image; convert it to JPEG")]:
        with pytest.raises(InputError, match=message):
            read(path)


def test_too_large_is_refused_from_the_header(tmp_path):
    path = store(tmp_path / "p.png", random_codes(20, 10, 3))
    with pytest.raises(InputError, match="10 x 20 = 0.0 megapixels exceed the limit of 0.0001; raise"):
        read(path, max_pixels=100)
    assert read(path, max_pixels=200).width == 10


def test_cmyk_is_refused(tmp_path):
    path = tmp_path / "p.jpg"
    inks = random_codes(8, 8, 4)
    path.write_bytes(imagecodecs.jpeg8_encode(inks, colorspace="cmyk", outcolorspace="cmyk"))
    with pytest.raises(InputError, match="a CMYK photograph; convert it to RGB"):
        read(path)


def test_a_profile_of_another_colour_model_is_refused(tmp_path):
    profile = bytearray(imagecodecs.cms_profile("srgb"))
    profile[16:20] = b"CMYK"
    path = store(tmp_path / "p.tif", random_codes(4, 4, 3), ICCProfile=bytes(profile))
    with pytest.raises(InputError, match="colour model 'CMYK'; convert the photograph"):
        read(path)
    assert read(path, "srgb").width == 4


@pytest.mark.parametrize("name", ["p.jpg", "p.png", "p.tif", "p.exr"])
def test_a_full_disk_leaves_neither_half_a_file_nor_takes_the_old_one(tmp_path, name):
    photograph = read(store(tmp_path / name, values_for(name, 64, 64)))
    target = tmp_path / f"fog_{name}"
    target.write_bytes(b"older result")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))  # as with a full disk, writing stops early
    try:
        with pytest.raises(InputError, match="cannot write the file: File too large; check that its folder"):
            write(target, photograph.radiance, photograph)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert target.read_bytes() == b"older result"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, target.name])


def test_a_missing_folder_is_said(tmp_path):
    photograph = read(store(tmp_path / "p.png", random_codes(4, 4, 3)))
    with pytest.raises(InputError, match="cannot write the file: No such file or directory"):
        write(tmp_path / "nowhere" / "fog.png", photograph.radiance, photograph)


def test_radiance_that_is_not_finite_is_a_bug(tmp_path):
    photograph = read(store(tmp_path / "p.png", random_codes(4, 4, 3)))
    radiance = photograph.radiance.copy()
    radiance[0, 0] = np.nan
    with pytest.raises(ValueError, match="3 values that are not finite"):
        encode(radiance, photograph)


def test_focal_length_from_exif(tmp_path):
    codes = random_codes(40, 60, 3)
    stated = store(tmp_path / "a.jpg", codes, Exif__FocalLengthIn35mmFilm=28, Exif__FocalLength=4.2)
    # 60 x 40 pixels at 2.5 a millimetre: a sensor of 24 x 16 mm, crop factor 1.5.
    by_sensor = store(tmp_path / "b.jpg", codes, Exif__FocalLength=20.0,
                      Exif__FocalPlaneXResolution=25.0, Exif__FocalPlaneResolutionUnit=3)
    silent = store(tmp_path / "c.jpg", codes, Exif__FocalLength=20.0)
    assert read_exif_focal_length(stated) == 28
    assert read_exif_focal_length(by_sensor) == pytest.approx(30, rel=1e-4)  # 43.267 mm is rounded
    assert read_exif_focal_length(silent) is None
    with pytest.raises(InputError, match="no such file"):
        read_exif_focal_length(tmp_path / "none.jpg")
