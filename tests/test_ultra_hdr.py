"""Ultra-HDR JPEGs made here from a known gain map give the known radiance back; and the fetching of one."""

import hashlib
import subprocess
import zipfile

import imagecodecs
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.imaging import fetch as fetching
from pipeline.imaging.colour import srgb_to_linear
from pipeline.imaging.maps import read_map, read_metadata
from pipeline.imaging.photograph import read
from pipeline.imaging.ultra_hdr import decode_ultra_hdr

BASE, GAIN = (128, 64, 200), 128
UNIFORM = np.ones((16, 32, 3), np.uint8)


def with_segment(jpeg, marker, payload):
    """`jpeg` with one more segment right behind its start."""
    return jpeg[:2] + bytes([0xFF, marker]) + (len(payload) + 2).to_bytes(2, "big") + payload + jpeg[2:]


def xmp(body):
    return b"http://ns.adobe.com/xap/1.0/\0" + f"<x:xmpmeta><rdf:Description {body}</x:xmpmeta>".encode()


def jpeg(values):
    # 4:4:4 at quality 100: a uniform picture then comes back within one code.
    return imagecodecs.jpeg8_encode(np.ascontiguousarray(values, np.uint8), level=100, subsampling="444")


def ultra_hdr(parameters='hdrgm:GainMapMax="4"/>', gain=GAIN * UNIFORM[:8, :16, 0], base=BASE * UNIFORM):
    base_jpeg = with_segment(jpeg(base), 0xE1, xmp('hdrgm:Version="1.0"/>'))
    # A thumbnail inside a segment of the base picture, as cameras put it: it has an end marker of its own.
    base_jpeg = with_segment(base_jpeg, 0xE1, b"Exif\0\0" + jpeg(UNIFORM[:8, :8]))
    return base_jpeg + with_segment(jpeg(gain), 0xE1, xmp(parameters))


def decoded_base(data):
    return srgb_to_linear(imagecodecs.jpeg8_decode(data)[8, 8] / 255.0)


def test_the_gain_is_applied_as_specified():
    data = ultra_hdr('hdrgm:GainMapMin="-1" hdrgm:GainMapMax="4" hdrgm:Gamma="2" hdrgm:OffsetSDR="0.1" '
                     'hdrgm:OffsetHDR="0.05"/>')
    # Adobe Gain Map 1.0, "decoding the gain map", written out for one pixel.
    expected = (decoded_base(data) + 0.1) * 2 ** (-1 + 5 * (GAIN / 255) ** 0.5) - 0.05
    radiance = decode_ultra_hdr(data)
    assert radiance.shape == (16, 32, 3) and radiance.dtype == np.float32
    assert radiance[8, 8] == pytest.approx(expected, rel=1e-5)  # float32 rounding of a few operations


def test_defaults_of_the_format_hold_where_parameters_are_silent():
    data = ultra_hdr()
    expected = (decoded_base(data) + 1 / 64) * 2 ** (4 * GAIN / 255) - 1 / 64
    assert decode_ultra_hdr(data)[8, 8] == pytest.approx(expected, rel=1e-5)


def test_parameters_may_differ_by_channel():
    per_channel = "<rdf:Seq><rdf:li>0</rdf:li><rdf:li>2</rdf:li><rdf:li>4</rdf:li></rdf:Seq>"
    data = ultra_hdr(f"><hdrgm:GainMapMax>{per_channel}</hdrgm:GainMapMax>", gain=255 * UNIFORM)
    base = decoded_base(data)
    assert decode_ultra_hdr(data)[8, 8] == pytest.approx((base + 1 / 64) * [1, 4, 16] - 1 / 64, rel=1e-5)


def test_it_agrees_with_an_independent_decoder():
    rng = np.random.default_rng(0)
    base = np.kron(rng.integers(20, 230, (4, 4, 3)), np.ones((16, 16, 1), int))
    gain = np.kron(rng.integers(0, 255, (4, 4)), np.ones((16, 16), int))
    data = ultra_hdr('hdrgm:Version="1.0" hdrgm:GainMapMin="0" hdrgm:GainMapMax="3" hdrgm:Gamma="1" '
                     'hdrgm:OffsetSDR="0.015625" hdrgm:OffsetHDR="0.015625" hdrgm:HDRCapacityMin="0" '
                     'hdrgm:HDRCapacityMax="3" hdrgm:BaseRenditionIsHDR="False"/>', gain, base)
    reference = imagecodecs.ultrahdr_decode(data)[..., :3].astype(float)
    difference = np.abs(decode_ultra_hdr(data) - reference) / (reference + 0.02)
    # The reference works with half floats and tables of 1024 steps: a median of 0.3 %.
    assert np.median(difference) < 0.01 and np.percentile(difference, 95) < 0.03


def test_as_a_photograph_it_is_its_eight_bit_picture(tmp_path):
    data = imagecodecs.ultrahdr_encode(np.full((16, 16, 4), 1.0, np.float16))
    (tmp_path / "p.jpg").write_bytes(data)
    photograph = read(tmp_path / "p.jpg")
    assert photograph.codes.dtype == np.uint8 and photograph.alpha is None
    assert np.array_equal(photograph.codes, imagecodecs.jpeg8_decode(data))


@pytest.mark.parametrize("data, message", [
    (b"not a JPEG", "not a JPEG file"),
    (jpeg(BASE * UNIFORM), "no gain map in this JPEG"),
    (ultra_hdr()[:-3], "truncated JPEG: its end marker is missing"),
    (ultra_hdr()[:30], "truncated or damaged JPEG"),
    (ultra_hdr('hdrgm:GainMapMax="bright"/>'), "hdrgm:GainMapMax = bright; give one finite number"),
    (ultra_hdr('hdrgm:GainMapMax="1" hdrgm:Gamma="0"/>'), "hdrgm:Gamma = 0;"),
    (ultra_hdr('hdrgm:GainMapMax="1" hdrgm:BaseRenditionIsHDR="True"/>'), "darkens an HDR picture")])
def test_what_cannot_be_decoded_is_said(data, message):
    with pytest.raises(InputError, match=message):
        decode_ultra_hdr(data)


DESCRIPTION = """
package: demo
version: "1.0"
file: demo/panorama.jpg
sha256: "{digest}"
title: Grey
author: Nobody
licence: CC0
source: made by the test
view: {{yaw_degree: 0, pitch_degree: 0, horizontal_field_of_view_degree: 60, width: 4, height: 3}}
exposure_gain: 0.5
"""


@pytest.fixture
def published(tmp_path, monkeypatch):
    """A scene folder, and a download that finds the test's own wheel instead of the network."""
    panorama = ultra_hdr()
    calls = []

    def download(command, **_):
        calls.append(command)
        folder = command[command.index("--dest") + 1]
        with zipfile.ZipFile(f"{folder}/demo-1.0-py3-none-any.whl", "w") as wheel:
            wheel.writestr("demo/panorama.jpg", panorama)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(fetching.subprocess, "run", download)
    (tmp_path / "photograph.yaml").write_text(DESCRIPTION.format(digest=hashlib.sha256(panorama).hexdigest()))
    return tmp_path, calls, panorama


def test_fetch_makes_the_view_with_its_gain(published):
    scene, calls, panorama = published
    path = fetching.fetch(scene)
    assert path == scene / "fetched" / "photograph.exr" and calls[0][-1] == "demo==1.0"
    assert read_map(path).shape == (3, 4, 3)
    assert read_map(path)[1, 1] == pytest.approx(0.5 * decode_ultra_hdr(panorama)[8, 8], rel=1e-5)  # float32
    assert read_metadata(path)["Copyright"] == "Grey by Nobody, CC0"


def test_fetch_refuses_another_file_than_was_described(published):
    scene, _, _ = published
    (scene / "photograph.yaml").write_text(DESCRIPTION.format(digest="0" * 64))
    with pytest.raises(InputError, match=r"photograph\.yaml: demo/panorama\.jpg has SHA-256 \w+, not 0{64}"):
        fetching.fetch(scene)
    assert not (scene / "fetched").exists()


@pytest.mark.parametrize("change, message", [
    (("demo/panorama.jpg", "demo/other.jpg"), "has no readable file demo/other.jpg"),
    (("width: 4", "width: 0"), r"photograph\.yaml: view\.width: .*given: 0"),
    (("package: demo", "package: --index"), r"photograph\.yaml: package: .*given: '--index'"),
    (("author", "painter"), r"photograph\.yaml: author: Field required"),
    (("title: Grey", "title: [Grey"), r"photograph\.yaml:\d+: not valid YAML")])
def test_a_wrong_description_is_said(published, change, message):
    scene, _, _ = published
    text = (scene / "photograph.yaml").read_text()
    (scene / "photograph.yaml").write_text(text.replace(*change))
    with pytest.raises(InputError, match=message):
        fetching.fetch(scene)


def test_offline_is_one_line_and_exit_status_2(published, monkeypatch, capsys):
    scene, _, _ = published
    monkeypatch.setattr(fetching.subprocess, "run", lambda command, **_: subprocess.CompletedProcess(
        command, 1, "", "WARNING: retrying\nERROR: No matching distribution found\n"))
    assert fetching.main([str(scene)]) == 2
    error = capsys.readouterr().err
    assert "cannot download demo==1.0 (ERROR: No matching distribution found)" in error
    assert error.count("\n") == 1
    assert fetching.main([str(scene / "nowhere")]) == 2
    assert "no such file; only scenes with this file" in capsys.readouterr().err
