"""Without fog the photograph comes back unchanged, and nothing is rendered or estimated for it."""

from __future__ import annotations

import json

import imagecodecs
import numpy as np
import OpenImageIO as oiio
import pytest

from pipeline.imaging.maps import read_map, read_metadata
from pipeline.rendering import povray
from pipeline.scene.artefacts import read_json

#: sRGB as a colour profile.
PROFILE = imagecodecs.cms_profile("srgb")
#: Ways of saying that there is no fog.
INFINITE = "  visibility: .inf"
ZERO = "  absorption_coefficient: [0, 0, 0]\n  scattering_coefficient: [0, 0, 0]"


def picture(dtype: str, channels: int) -> np.ndarray:
    """(18, 24, channels) with all the range that the type has; alpha from 0 to opaque."""
    values = np.random.default_rng(5).random((18, 24, channels))
    if dtype == "float":  # brighter than white, out of gamut
        values[..., :3] = values[..., :3] * 40 - 0.5
        return values.astype(np.float32)
    top = np.iinfo(dtype).max
    codes = np.rint(values * top).astype(dtype)
    codes[0, :3] = np.array([0, 1, top])[:, None]
    return codes


def written(path, codes: np.ndarray, stored: str | None = None, **attributes) -> None:
    """The file of a camera or paint program, by OpenImageIO."""
    height, width, channels = codes.shape
    spec = oiio.ImageSpec(width, height, channels, stored or {"uint8": "uint8", "uint16": "uint16"}.get(
        codes.dtype.name, "float"))
    if channels in (2, 4):
        spec.alpha_channel = channels - 1
        spec.channelnames = (*(("R", "G", "B") if channels == 4 else ("Y",)), "A")
        if path.suffix != ".exr":
            spec.attribute("oiio:UnassociatedAlpha", 1)
    if attributes.pop("profile", False):
        data_type = oiio.TypeDesc(f"uint8[{len(PROFILE)}]")
        spec.attribute("ICCProfile", data_type, np.frombuffer(PROFILE, np.uint8))
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(np.ascontiguousarray(codes)) and output.close()


KINDS = {
    "jpeg": ("photograph.jpg", "uint8", 3, dict(compression="jpeg:90")),
    "jpeg with profile, turned by EXIF": ("photograph.jpg", "uint8", 3, dict(
        profile=True, Orientation=6, Make="Camera", Exif__FocalLengthIn35mmFilm=28.0)),
    "grey jpeg": ("photograph.jpeg", "uint8", 1, {}),
    "png": ("photograph.png", "uint8", 3, {}),
    "png with alpha and profile": ("photograph.png", "uint8", 4, dict(profile=True)),
    "png of 16 bits": ("photograph.png", "uint16", 3, {}),
    "grey png of 16 bits with alpha": ("photograph.png", "uint16", 2, {}),
    "tiff": ("photograph.tif", "uint8", 3, dict(Orientation=3)),
    "tiff of 16 bits with alpha and profile": (
        "photograph.tiff", "uint16", 4, dict(profile=True, compression="lzw")),
    "float tiff": ("photograph.tif", "float", 3, {}),
    "exr": ("photograph.exr", "float", 3, dict(owner="somebody")),
    "half exr with alpha": ("photograph.exr", "float", 4, dict(stored="half", Make="Camera")),
    "grey exr": ("photograph.exr", "float", 1, {}),
    "hdr": ("photograph.hdr", "float", 3, {}),
}


@pytest.fixture
def no_povray(monkeypatch):
    """A render without fog would be one that nobody asked for."""
    def refuse(pov, *_, **__):
        pytest.fail(f"{pov.name} is rendered although there is no fog")

    monkeypatch.setattr(povray, "render", refuse)


@pytest.mark.parametrize("kind", KINDS)
def test_photograph_comes_back(kind, tiny_scene, no_povray):
    file, dtype, channels, attributes = KINDS[kind]
    codes = np.abs(picture(dtype, channels)) if file.endswith(".hdr") else picture(dtype, channels)
    original = tiny_scene.folder / file
    written(original, codes, **attributes)
    tiny_scene.replace("file: photograph.png", f"file: {file}")
    tiny_scene.replace("  visibility: 6", INFINITE)
    assert tiny_scene.run() == 0

    out = tiny_scene.build.out
    suffix = {".jpeg": ".jpg", ".tiff": ".tif"}.get(original.suffix, original.suffix)
    assert (out / f"foggy{suffix}").read_bytes() == original.read_bytes()
    height, width = read_map(out / "photograph.exr").shape[:2]
    assert (height, width) == ((24, 18) if attributes.get("Orientation") == 6 else (18, 24))
    if dtype != "float":
        stored = imagecodecs.imread(str(original))  # not what wrote it, nor what the pipeline reads it with
        turns = {3: 2, 6: -1}.get(attributes.get("Orientation"), 0)
        upright = np.rot90(stored.reshape(*stored.shape[:2], -1), turns)
        shown = imagecodecs.png_decode((out / "foggy.png").read_bytes())
        assert shown.dtype == codes.dtype
        assert np.array_equal(shown.reshape(*shown.shape[:2], -1), upright)
    if attributes.get("profile"):
        assert profile_of(out / "foggy.png") == PROFILE
    assert (out / "foggy.exr").is_file() and (out / "foggy.png").is_file()
    if suffix != ".exr":
        assert np.array_equal(read_map(out / "foggy.exr"), read_map(out / "photograph.exr"))


def profile_of(path) -> bytes:
    return np.asarray(oiio.ImageInput.open(str(path)).spec().getattribute("ICCProfile"), np.uint8).tobytes()


@pytest.mark.parametrize("fog", [INFINITE, ZERO], ids=["infinite visibility", "coefficients 0"])
def test_nothing_is_rendered_or_estimated(fog, tiny_scene, no_povray):
    """Not even where strengths are to be estimated: without fog nobody asks for them."""
    tiny_scene.replace("    radiance: [4, 4, 4]\n", "")
    tiny_scene.replace("    intensity: [0.5, 0.4, 0.3]\n", "")
    tiny_scene.replace("  visibility: 6", fog)
    assert tiny_scene.run() == 0
    build = tiny_scene.build
    plan = read_json(build.plan)
    assert plan["fog_is_clear"] and plan["runs"] == [] and plan["lights"] == []
    assert "the photograph comes back unchanged" in plan["reasons"][0]
    illumination = read_json(build.illumination)
    assert illumination["estimator"] == "none needed: the fog is clear" and illumination["lights"] == {}
    assert not list(build.shared.rglob("*.pov"))
    for path, value in ((build.transmittance, 1), (build.in_scattering(), 0)):
        assert read_map(path).shape == (18, 24, 3) and (read_map(path) == value).all()
        metadata = read_metadata(path)
        assert metadata["fog:scene"] == "tiny" and set(metadata["fog:scattering_coefficient_per_m"]) == {0.0}
    assert (build.out / "foggy.png").stat().st_size > 0


def test_report_without_fog(tiny_scene, no_povray):
    tiny_scene.replace("  visibility: 6", INFINITE)
    assert tiny_scene.run() == 0 and tiny_scene.run("report") == 0
    manifest = json.loads(tiny_scene.build.manifest.read_text())
    assert "foggy.png" in manifest["outputs"] and manifest["seconds"]["runs"] == {}
    assert "tiny" in tiny_scene.build.report.read_text()


def test_light_is_estimated_once_a_fog_needs_it_and_then_kept(tiny_scene):
    """The strengths belong to all fogs of a scene: one without fog neither makes nor spoils them."""
    build = tiny_scene.build
    stamp = build.input("demand")
    assert tiny_scene.run(overrides=("fog.visibility=.inf",)) == 0
    assert read_json(stamp) == {"light_strengths": False}
    assert tiny_scene.run("resolve", fog="thick") == 0
    assert read_json(stamp) == {"light_strengths": True}, "Make redoes what depends on it"
    assert tiny_scene.run("illumination", fog="thick") == 0
    made, before = read_json(build.illumination), stamp.stat().st_mtime_ns
    assert set(made["lights"]) == {"lamp", "bulb"}
    assert tiny_scene.run("resolve", overrides=("fog.visibility=.inf",)) == 0
    assert stamp.stat().st_mtime_ns == before
    assert tiny_scene.run("illumination") == 0
    assert read_json(build.illumination) == made


def test_results_of_an_earlier_fog_go(tiny_scene):
    build = tiny_scene.build
    assert tiny_scene.run() == 0
    assert build.in_scattering("lamp").exists() and list(build.runs.glob("*.exr"))
    assert tiny_scene.run(overrides=("fog.visibility=.inf",)) == 0
    assert not list(build.out.glob("in_scattering_*.exr"))
    assert not list(build.runs.glob("*.exr")) and not list(build.pov.glob("*.pov"))
    assert (read_map(build.transmittance) == 1).all() and not read_map(build.in_scattering()).any()


@pytest.mark.parametrize("fog", [None, "fog.visibility=.inf"])
@pytest.mark.parametrize("working_size", ["null", "64"])
def test_exposure(fog, working_size, tiny_scene):
    """A stop more is twice as bright; the rest of the results stay, and nothing is rendered for it."""
    write_png = imagecodecs.png_encode(np.tile(np.linspace(10, 90, 96)[None, :, None], (72, 1, 3)).astype(np.uint8))
    (tiny_scene.folder / "photograph.png").write_bytes(write_png)
    asked = (f"photograph.working_size={working_size}", *([fog] if fog else []))
    assert tiny_scene.run(overrides=asked) == 0
    build = tiny_scene.build
    assert (build.shared / "working").exists() == (working_size == "64")
    before, maps = read_map(build.foggy(".exr")), read_map(build.transmittance)
    assert tiny_scene.run("resolve", "composite", "report", overrides=(*asked, "composite.exposure=1")) == 0
    np.testing.assert_allclose(read_map(build.foggy(".exr")), 2 * before, rtol=1e-3)
    assert np.array_equal(read_map(build.transmittance), maps)
    assert read_metadata(build.foggy(".exr"))["fog:exposure_ev"] == 1
    assert build.foggy(".png").read_bytes() != (tiny_scene.folder / "photograph.png").read_bytes()
