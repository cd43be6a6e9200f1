"""A plugin says the same in Python and in POV-Ray's language."""

import numpy as np
import pytest

from pipeline.imaging.maps import read_map
from pipeline.plugins.registry import registry
from pipeline.rendering import povray
from pipeline.rendering.emit import Run, Templates, emit
from pipeline.plugins.lights.ambient import Ambient
from pipeline.scene.artefacts import read_fog, read_placed
from pipeline.scene.placed import PlacedScene
from tests.test_light_transport import COLOUR, DESCRIBED, chain


def rendered(folder, one, scene, **options):
    pov, image = folder / f"{one.id}.pov", folder / f"{one.id}.exr"
    pov.write_text(emit(one, scene, Templates(), **options))
    povray.render(pov, image, one.width, one.height)
    return read_map(image).astype(float) / one.exposure


def test_ambient_light(tmp_path):
    build = chain(tmp_path, {"point": DESCRIBED["point"], "reflected": {"type": "ambient", "radiance": [0.3, 0.2, 0.1]}})
    scene, medium = read_placed(build), read_fog(build)
    one = Run("glow", "in_scattering", ["reflected"], scene.camera.width, scene.camera.height, 4.0, samples=48)
    glow = rendered(tmp_path, one, scene, medium=medium)
    closed_form = read_map(build.in_scattering("reflected"))
    # half floats hold 11 bits
    np.testing.assert_allclose(glow * [0.3, 0.2, 0.1], closed_form, rtol=2e-3)
    assert not (build.pov / "in_scattering_reflected.pov").exists(), "what has a closed form is not rendered"


def test_furnace(tmp_path):
    """Surfaces as bright as the light between them: fog that absorbs nothing is invisible."""
    build = chain(tmp_path, {"reflected": {"type": "ambient", "radiance": [0.5] * 3}}, photograph=0.5,
                  fog={"type": "homogeneous", "visibility": 2.0, "phase_function": {"type": "isotropic"}})
    np.testing.assert_allclose(read_map(build.foggy(".exr")), 0.5, rtol=1e-5)


@pytest.mark.parametrize("kind", sorted(registry("phase_functions")))
def test_phase_functions(tmp_path, kind):
    """V of a bulb, rendered, over the plugin's own phase function by a fine midpoint sum along each ray."""
    build = chain(tmp_path, {"point": DESCRIBED["point"]}, render={"glow": "rendered", "samples": 24, "in_scattering_size": 256},
                  fog={"type": "homogeneous", "absorption_coefficient": [0.05] * 3,
                       "scattering_coefficient": [0.1] * 3, "phase_function": {"type": kind}})
    scene, medium = read_placed(build), read_fog(build)
    directions = scene.camera.directions(scene.camera.pixel_centres())
    depth = read_map(build.depth).astype(float)
    total = np.zeros(depth.shape)
    steps = 1500
    for k in range(steps):
        points = scene.camera.position + (depth * (k + 0.5) / steps)[..., None] * directions
        irradiance, path = scene.lights["point"].incident(points)
        to_sample = (points - scene.lights["point"].position.vector) / path[..., None]
        phase = medium.phase().value(-(to_sample * directions).sum(-1))
        total += 0.1 * phase * irradiance * np.exp(-0.15 * (path + depth * (k + 0.5) / steps)) * depth / steps
    error = np.abs(read_map(build.in_scattering())[..., 0] / (COLOUR[0] * total) - 1)
    # the renderer's 72 samples and half floats; the sum's own error is a hundredth of that
    assert np.median(error) < 2e-3 and np.percentile(error, 99) < 0.02


def test_polygon_and_cuboid_end_rays_where_python_does(tmp_path):
    """T of a black-box kind: what POV-Ray dims on the way to each face is exp(-kappa depth)."""
    build = chain(tmp_path, {"point": DESCRIBED["point"]}, box=True)
    scene, medium = read_placed(build), read_fog(build)
    polygon = registry("shapes")["polygon"].model_validate(
        {"type": "polygon", "outline": {"points": [[-1.2, 0.1, -0.6], [-0.4, 0.1, -0.9], [-0.4, 1.6, -0.9], [-1.2, 1.6, -0.6],
                                                   [-1.0, 0.8, -0.675]]}})
    scene = PlacedScene(scene.camera, {**scene.shapes, "leaf": polygon}, {"sky": Ambient(type="ambient")},
                        scene.exporter)
    one = Run("veil", "in_scattering", ["sky"], scene.camera.width, scene.camera.height, 4.0, samples=48)
    veil = rendered(tmp_path, one, scene, medium=medium)
    directions = scene.camera.directions(scene.camera.pixel_centres())
    depth = np.min([s.intersect(scene.camera.position, directions)[0] for s in scene.shapes.values()], axis=0)
    expected = scene.lights["sky"].in_scattering(medium, scene.camera.position, directions, depth)
    error = np.abs(veil / expected - 1).max(-1)
    # a ray within rounding of an edge may take either side: none of 1728 should, two may
    assert (error > 3e-3).sum() <= 2, error.max()
