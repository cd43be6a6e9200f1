"""Maps as OpenEXR files: exact values, channel names, metadata, refusals."""

import numpy as np
import OpenImageIO as oiio
import pytest

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map, read_metadata, write_map


def header(path):
    return oiio.ImageInput.open(str(path)).spec()


def store(path, values, names, sample_type):
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], sample_type)
    spec.channelnames = names
    output = oiio.ImageOutput.create("openexr")
    assert output.open(str(path), spec)
    assert output.write_image(values.astype(np.float32)) and output.close()
    return path


@pytest.mark.parametrize("shape, is_depth, names", [
    ((5, 7, 3), False, ("R", "G", "B")), ((5, 7), False, ("Y",)), ((5, 7, 1), True, ("Z",)),
    ((1, 1), True, ("Z",))])
def test_values_come_back_exactly(tmp_path, shape, is_depth, names):
    values = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    values.flat[0] = 1e-30  # far below what a half float holds
    write_map(tmp_path / "m.exr", values, is_depth=is_depth)
    expected = values if values.shape[-1:] == (3,) else values.reshape(shape[:2])
    assert np.array_equal(read_map(tmp_path / "m.exr"), expected)
    spec = header(tmp_path / "m.exr")
    assert spec.channelnames == names and str(spec.format) == "float"
    assert spec.get_string_attribute("compression").startswith("zip")


def test_infinite_depth_of_the_sky_is_kept(tmp_path):
    write_map(tmp_path / "depth.exr", np.array([[2.5, np.inf]]), is_depth=True)
    assert read_map(tmp_path / "depth.exr").tolist() == [[2.5, np.inf]]


def test_metadata_comes_back(tmp_path):
    given = {"fog:visibility_m": 20.5, "fog:name": "morning", "fog:layers": 2,
             "fog:extinction_per_m": (1.5, 2.0, 3.0)}
    write_map(tmp_path / "m.exr", np.ones((2, 2)), given)
    metadata = read_metadata(tmp_path / "m.exr")
    assert {name: metadata[name] for name in given} == given


@pytest.mark.parametrize("names", [("R", "G", "B"), ("R", "G", "B", "A"), ("B", "G", "R")])
def test_half_floats_as_the_renderer_writes_them(tmp_path, names):
    values = np.random.default_rng(1).random((4, 6, len(names))).astype(np.float16)
    path = store(tmp_path / "render.exr", values, names, "half")
    expected = values[..., [names.index(name) for name in "RGB"]].astype(np.float32)
    assert read_map(path).dtype == np.float32 and np.array_equal(read_map(path), expected)


def test_what_is_no_map_is_refused(tmp_path):
    (tmp_path / "text.exr").write_text("no map")
    layered = store(tmp_path / "uv.exr", np.zeros((2, 2, 2)), ("U", "V"), "float")
    cut = tmp_path / "cut.exr"
    write_map(cut, np.random.default_rng(2).random((32, 32)))
    cut.write_bytes(cut.read_bytes()[:2000])
    for path, message in [(tmp_path / "none.exr", "no such map"),
                          (tmp_path / "text.exr", "not a readable OpenEXR"),
                          (layered, "a map with the channels U, V"), (cut, "truncated or damaged map")]:
        with pytest.raises(InputError, match=message) as caught:
            read_map(path)
        assert str(path) in str(caught.value)


def test_a_map_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match="cannot write the file"):
        write_map(tmp_path / "missing" / "m.exr", np.ones((2, 2)))
    (tmp_path / "m.exr").mkdir()  # a folder stands where the map should go
    with pytest.raises(InputError, match="cannot write the file"):
        write_map(tmp_path / "m.exr", np.ones((2, 2)))
    assert [path.name for path in tmp_path.iterdir()] == ["m.exr"]


def test_a_shape_that_is_no_map_is_a_bug(tmp_path):
    with pytest.raises(ValueError, match=r"shape \(2, 2, 4\)"):
        write_map(tmp_path / "m.exr", np.ones((2, 2, 4)))
    with pytest.raises(TypeError, match="fog:top_m: None"):
        write_map(tmp_path / "m.exr", np.ones((2, 2)), {"fog:top_m": None})
