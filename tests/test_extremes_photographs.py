"""Photographs of every awkward kind, through the command line: sane maps, or one line."""

from __future__ import annotations

import imagecodecs
import numpy as np
import OpenImageIO as oiio
import pytest

from tests.extremes.scenes import described, maps, prepared, run


def shot(folder, file: str, values: np.ndarray, **attributes):
    """The scene with this file as its photograph."""
    scene = prepared(folder, described(photograph={"file": file}))
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, values.dtype.name if values.dtype != np.float32 else "float")
    for name, value in attributes.items():
        if isinstance(value, bytes):
            spec.attribute(name, oiio.TypeDesc(f"uint8[{len(value)}]"), np.frombuffer(value, np.uint8))
        else:
            spec.attribute(name, value)
    output = oiio.ImageOutput.create(str(scene.folder / file))
    assert output.open(str(scene.folder / file), spec)
    assert output.write_image(np.ascontiguousarray(values)) and output.close()
    return scene


@pytest.mark.parametrize("width,height", [(1, 1), (1, 17), (17, 1)])
def test_smallest(tmp_path, width, height):
    """One pixel is a photograph: its maps have its shape."""
    assert run(tmp_path, described(), (width, height)).transmittance.shape == (height, width, 3)


def holes():
    values = np.full((18, 24, 3), 0.5, np.float32)
    values[2, 3], values[5, 6], values[8, 9] = np.nan, np.inf, -np.inf
    return values


KINDS = {
    "black": ("a.png", np.zeros((18, 24, 3), np.uint8), {}),
    "fully clipped": ("a.png", np.full((18, 24, 3), 255, np.uint8), {}),
    "16 bit": ("a.png", np.full((18, 24, 3), 30000, np.uint16), {}),
    "NaN and Inf": ("a.exr", holes(), {}),
    "alpha": ("a.png", np.full((18, 24, 4), 128, np.uint8), {}),
    "grey": ("a.png", np.full((18, 24, 1), 128, np.uint8), {}),
    "turned": ("a.jpg", np.full((24, 18, 3), 128, np.uint8), {"Orientation": 6})}


@pytest.mark.parametrize("kind", KINDS)
def test_kinds(tmp_path, kind):
    """Finite, C between V and clear + V; T and V do not depend on what the photograph shows."""
    file, values, attributes = KINDS[kind]
    scene = shot(tmp_path, file, values, **attributes)
    assert scene.run() == 0
    found = maps(scene)
    assert found.transmittance.shape == (18, 24, 3)
    if kind == "black":  # C = V
        assert np.allclose(found.foggy, found.in_scattering, rtol=1e-6)


def test_cmyk(tmp_path, capsys):
    scene = prepared(tmp_path, described(photograph={"file": "a.jpg"}))
    ink = np.full((18, 24, 4), 100, np.uint8)
    (scene.folder / "a.jpg").write_bytes(imagecodecs.jpeg8_encode(ink, colorspace="CMYK", outcolorspace="CMYK"))
    assert scene.run() != 0
    said = capsys.readouterr().err
    assert "CMYK" in said and "Traceback" not in said


def test_wide_gamut(tmp_path):
    """A grey is the same grey in any colour space: AdobeRGB's curve, 2.19921875, gives (128/255)^2.2 of it."""
    profile = imagecodecs.cms_profile("adobergb")
    scene = shot(tmp_path, "a.png", np.full((18, 24, 3), 128, np.uint8), ICCProfile=profile)
    assert scene.run() == 0
    found = maps(scene)
    clear = (found.foggy - found.in_scattering) / found.transmittance
    # profiles hold 16-bit fixed-point numbers
    assert np.allclose(clear, (128 / 255) ** 2.19921875, rtol=2e-3)


@pytest.mark.slow
def test_fifty_megapixels(tmp_path):
    """Maps of the photograph's own size."""
    scene = described(render={"samples": 2, "in_scattering_size": 64})
    assert run(tmp_path, scene, (8660, 5774)).transmittance.shape == (5774, 8660, 3)
