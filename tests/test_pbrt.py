"""pbrt-v4 scenes, checked by a reader of our own."""

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.scene.artefacts import read_camera, read_placed
from tests.reference import pbrt_reader
from tests.test_light_transport import DESCRIBED, chain


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pbrt")
    build = chain(folder, {kind: DESCRIBED[kind] for kind in ("point", "spot", "area", "sun")}, box=True)
    assert main(["export", "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds),
                 "--to", "pbrt"]) == 0
    return build, {path.stem: path.read_text() for path in build.export("pbrt").glob("*.pbrt")}


def test_every_file_is_sound_and_complete(exported):
    build, files = exported
    assert {f"{what}_{light}" for what in ("in_scattering", "transmittance", "clear") for light in ("point", "spot", "area", "sun")
            } | {"foggy"} == set(files)
    for text in files.values():
        pbrt_reader.read(text)
    assert "'sun'" in files["foggy"].partition("Integrator")[0]


def test_sunlight_begins_at_the_fogs_border_and_is_scattered_in_its_shafts_alone(exported):
    build, files = exported
    found = pbrt_reader.read(files["in_scattering_sun"])
    media = {names[0]: parameters for directive, names, parameters in found if directive == "MakeNamedMedium"}
    assert media["fog"]["rgb sigma_s"] == [0, 0, 0] and max(media["lit_fog"]["rgb sigma_s"]) > 0
    assert np.allclose(media["fog"]["rgb sigma_a"], np.add(media["lit_fog"]["rgb sigma_a"], media["lit_fog"]["rgb sigma_s"]))
    borders = [names for directive, names, _ in found if directive == "MediumInterface"]
    assert ["fog", ""] in borders and ["lit_fog", "fog"] in borders
    distant = next(p for d, names, p in found if names == ["distant"])
    assert np.allclose(np.subtract(distant["point3 to"], distant["point3 from"]), read_placed(build).lights["sun"].direction)
    hulls = [p for (_, before, _), (_, names, p) in zip(found, found[2:])
             if names == ["trianglemesh"] and before[:1] in (["fog"], ["lit_fog"])]
    assert len(hulls) >= 2
    for hull in hulls:
        corners = np.reshape(hull["point3 P"], (-1, 3))[np.reshape(hull["integer indices"], (-1, 3)).astype(int)]
        volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
        assert volume > 0.01, "its normals point outwards"
    assert all(names != ["fog", ""] for _, names, _ in pbrt_reader.read(files["in_scattering_point"]))


def test_the_camera_sees_pixels_where_ours_does(exported):
    build, files = exported
    camera = read_camera(build)
    directives = {name: parameters for name, _, parameters in pbrt_reader.read(files["foggy"])}
    matrix = np.array(directives["Transform"]["matrix"]).reshape(4, 4).T
    left, right, bottom, top = directives["Camera"]["float screenwindow"]
    pixel = np.array([3.5, 20.5])
    point = matrix @ np.append(camera.position + 2.5 * camera.directions(pixel), 1)
    x, y = point[:2] / point[2]
    assert np.allclose([(x - left) / (right - left) * camera.width, (top - y) / (top - bottom) * camera.height], pixel)


def test_what_fogs_absorb_and_scatter_is_stated(exported):
    build, files = exported

    def medium(name):
        return next(p for d, _, p in pbrt_reader.read(files[name]) if d == "MakeNamedMedium")

    foggy, reduced = medium("foggy"), medium("transmittance_area")
    assert np.allclose(np.add(foggy["rgb sigma_a"], foggy["rgb sigma_s"]), reduced["rgb sigma_a"])
    assert reduced["rgb sigma_s"] == [0, 0, 0] and max(foggy["rgb sigma_s"]) > 0
    assert "MakeNamedMedium" not in files["clear_area"]


@pytest.mark.parametrize("old, new, complaint", [
    ("AttributeEnd", "", "AttributeEnd"), ("Integrator", "Intergator", "no directive is called Intergator"),
    ('"float fov" [ 90 ]', '"float fov" [ nan ]', "not finite"), ('"float fov" [ 90 ]', "", "lacks float fov"),
    ('MediumInterface "" "fog"', 'MediumInterface "" "smoke"', "no medium is called 'smoke'"),
    ("[ 90 ]", "[ 90", "no value|is no value|without"), ('"float fov" [ 90 ]', '"float fov" [ "90" ]', "another kind"),
    ("WorldBegin", "", "wrong side"), ('"integer indices" [ 0', '"integer indices" [ 99', "indices"),
    ('"rgb L"', '"rgb radiance"', "lacks rgb L"), ('Camera "perspective"', 'Camera "fisheye"', "knows no 'fisheye'"),
])
def test_the_reader_refuses_broken_files(exported, old, new, complaint):
    text = exported[1]["in_scattering_area"]
    assert old in text
    with pytest.raises(pbrt_reader.Unsound, match=complaint):
        pbrt_reader.read(text.replace(old, new, 1))
