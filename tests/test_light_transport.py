"""T and V of the whole chain against quadrature that shares nothing with the renderer.

At the default quality: median relative error <= 1 % (V) and 0.5 % (T), 99th percentile <= 5 %, away from
pixels that show the lamp itself.
"""

import json

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.geometry.planes import polygon_normal
from pipeline.geometry.raycast import first_hits
from pipeline.imaging.maps import read_map, read_metadata, write_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_placed
from tests.reference import quadrature as reference

CHAIN = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination", "plan", "emit",
         "render", "decompose", "composite")
ABSORPTION, SCATTERING, ASYMMETRY = 0.05, 0.1, 0.3
SIZE = (48, 36)
SUN = np.array([0.63, -0.76, 0.11]) / np.linalg.norm([0.63, -0.76, 0.11])
WINDOW = np.array([[-1.5, 1, -2.4], [-1.5, 2, -2.4], [-1.5, 2, -1.5], [-1.5, 1, -1.5]])
PATCH = WINDOW - SUN * (WINDOW[:, 1:2] / SUN[1])
LAMP = np.array([[-0.25, 2.39, -1.7], [0.25, 2.39, -1.7], [0.25, 2.39, -1.3], [-0.25, 2.39, -1.3]])
COLOUR = [3.0, 2.0, 1.0]
CONE = np.cos(np.radians([20.0, 35.0]))


def _cone(cosine):
    x = np.clip((cosine - CONE[1]) / (CONE[0] - CONE[1]), 0, 1)
    return x * x * (3 - 2 * x)


def _outline(points):
    return {"points": [[float(x) for x in p] for p in points]}


DESCRIBED = {
    "point": {"type": "point", "position": {"point": [-0.5, 1.7, -1.6]}, "intensity": COLOUR, "radius": 0.02},
    "spot": {"type": "spot", "position": {"point": [-0.6, 2.2, -1.2]}, "target": {"point": [0.3, 0.0, -1.4]},
             "inner_angle": 20.0, "outer_angle": 35.0, "intensity": COLOUR, "radius": 0.02},
    "area": {"type": "area", "outline": _outline(LAMP), "radiance": COLOUR, "faces_towards": [0, 1, -1.5]},
    "sun": {"type": "sun", "direction": SUN.tolist(), "irradiance": COLOUR,
            "openings": {"window": {"window": _outline(WINDOW), "patches": [_outline(PATCH)]}}},
}
REFERENCE = {
    "point": reference.PointLight(np.array([-0.5, 1.7, -1.6]), np.array(COLOUR), 0.02),
    "spot": reference.SpotLight(np.array([-0.6, 2.2, -1.2]), np.array(COLOUR), 0.02,
                                np.array([0.9, -2.2, -0.2]) / np.linalg.norm([0.9, -2.2, -0.2]), _cone,
                                tuple(CONE)),
    "area": reference.RectangleLight(LAMP[0], LAMP[1] - LAMP[0], LAMP[3] - LAMP[0], np.array(COLOUR)),
    "sun": reference.SunWindow(np.array(COLOUR), SUN, WINDOW),
}


def chain(folder, lights, *, box=False, fog=None, render=None, photograph=0.5, stages=CHAIN) -> Build:
    """The pipeline's stages over a small room of known geometry."""
    build = Build("room", None, folder / "scenes", folder / "build")
    build.source.mkdir(parents=True)
    write_map(build.source / "photograph.exr", np.full((SIZE[1], SIZE[0], 3), photograph, np.float32))
    shapes = {"room": {"type": "room", "lower": [-1.5, 0, -3], "upper": [1.5, 2.4, 1.6]}}
    if box:
        shapes["box"] = {"type": "cuboid", "centre": [0.25, 0.5, -1.3], "size": [0.6, 1.0, 0.5], "yaw": 18.0}
    scene = {
        "photograph": {"file": "photograph.exr"},
        "camera": {"position": [0.03, 1.43, 1.3], "look_at": [0.02, 1.1, -2], "horizontal_field_of_view": 65},
        "shapes": shapes, "lights": lights, "illumination": {"type": "manual"},
        "fog": fog or {"type": "homogeneous", "absorption_coefficient": [ABSORPTION] * 3,
                       "scattering_coefficient": [SCATTERING] * 3,
                       "phase_function": {"type": "henyey_greenstein", "asymmetry": ASYMMETRY}}}
    scene["render"] = {"quality": "final", "checked_pixels": 0, **(render or {})}
    build.scene_file.write_text(json.dumps(scene))  # JSON is YAML
    run(build, stages=stages)
    return build


def run(build: Build, *overrides: str, stages=CHAIN) -> None:
    for stage in stages:
        stated = [f"--set={override}" for override in overrides] if stage == "resolve" else []
        assert main([stage, "--scene", build.scene, "--scenes", str(build.scenes),
                     "--build", str(build.builds), *stated]) == 0, stage


def reference_rays(build: Build):
    """Rays of the placed scene, its occluders, and which pixels (N,) show a lamp."""
    scene = read_placed(build)
    directions = scene.camera.directions(scene.camera.pixel_centres())
    names, faces = zip(*scene.faces())
    depth, index = first_hits(scene.camera.position, directions, list(faces))
    normals = np.array([polygon_normal(face) for face in faces])[index]
    normals = np.where((normals * directions).sum(-1, keepdims=True) > 0, -normals, normals)
    lamp = (read_map(build.surfaces)[..., 1] >= 0).ravel()
    rays = reference.Rays(scene.camera.position, directions.reshape(-1, 3), depth.ravel(),
                          normals.reshape(-1, 3), lamp)
    return rays, [face for name, face in zip(names, faces) if name.startswith("box")], lamp


@pytest.mark.parametrize("box", [False, True], ids=["unoccluded", "occluded"])
@pytest.mark.parametrize("kind", list(DESCRIBED))
def test_against_quadrature(tmp_path, kind, box):
    build = chain(tmp_path, {kind: DESCRIBED[kind]}, box=box)
    rays, occluders, lamp = reference_rays(build)
    medium = reference.Medium(ABSORPTION, SCATTERING, reference.henyey_greenstein(ASYMMETRY))
    v = reference.in_scattering(rays, medium, REFERENCE[kind], occluders)
    t = reference.transmittance(rays, medium, [REFERENCE[kind]], occluders)

    # a ten-thousandth of the brightest is black beside it; relative error says nothing there
    seen = ~lamp[:, None] & (v > 1e-4 * v.max())
    error = np.abs(read_map(build.in_scattering()).reshape(-1, 3) / np.where(seen, v, 1) - 1)[seen]
    median, p99 = np.percentile(error, [50, 99])
    assert median <= 0.01 and p99 <= 0.05, (median, p99)
    dark = ~lamp[:, None] & (v == 0)
    assert not dark.any() or read_map(build.in_scattering()).reshape(-1, 3)[dark].max() <= 2e-3 * v.max()

    lit = np.isfinite(t) & ~lamp[:, None]
    assert lit.mean() > 0.01
    error = np.abs(read_map(build.transmittance).reshape(-1, 3) / np.where(lit, t, 1) - 1)[lit]
    median, p99 = np.percentile(error, [50, 99])
    assert median <= 0.005 and p99 <= 0.05, (median, p99)


@pytest.mark.parametrize("extinction", [1e-12, 1e-3, 3.0, 30.0, 1e4])
def test_extremes_of_density(tmp_path, extinction):
    """Finite, 0 <= T <= 1, V >= 0, and T in the closed form's neighbourhood, however thin or dense the fog."""
    lights = {**{kind: DESCRIBED[kind] for kind in ("point", "spot", "sun")}, "reflected": {"type": "ambient", "radiance": COLOUR},
              "area": {**DESCRIBED["area"], "sub_lights": 2}}
    build = chain(tmp_path, lights, box=True, render={"samples": 4},
                  fog={"type": "homogeneous", "absorption_coefficient": [0.2 * extinction] * 3,
                       "scattering_coefficient": [0.8 * extinction] * 3,
                       "phase_function": {"type": "henyey_greenstein", "asymmetry": 0.9}})
    t, v, c = (read_map(path) for path in (build.transmittance, build.in_scattering(), build.foggy(".exr")))
    assert np.isfinite(t).all() and np.isfinite(v).all() and np.isfinite(c).all()
    eye = np.exp(-extinction * read_map(build.depth).astype(float))[..., None]
    # half floats on the way of the light and back: 2^-10
    assert t.min() >= 0 and (t <= eye * 1.001 + 1e-30).all() and v.min() >= 0
    if extinction == 1e-12:
        np.testing.assert_allclose(c, 0.5, rtol=1e-3)
    if extinction >= 30:  # nothing from beyond; the ambient light's part is known
        assert t.max() < 1e-6 and v.max() > 0.79 * max(COLOUR)


def test_lights_together_and_spectral_fog(tmp_path):
    absorption, scattering = [0.02, 0.05, 0.1], [0.1, 0.15, 0.3]
    build = chain(tmp_path, {kind: DESCRIBED[kind] for kind in ("point", "area", "sun")}, box=True,
                  fog={"type": "homogeneous", "absorption_coefficient": absorption,
                       "scattering_coefficient": scattering, "phase_function": {"type": "rayleigh"}})
    rays, occluders, lamp = reference_rays(build)
    medium = reference.Medium(np.array(absorption), np.array(scattering), reference.rayleigh)
    lights = [REFERENCE[kind] for kind in ("point", "area", "sun")]
    v = sum(reference.in_scattering(rays, medium, light, occluders) for light in lights)
    error = np.abs(read_map(build.in_scattering()).reshape(-1, 3) / v - 1)[~lamp]
    assert np.median(error) <= 0.01 and np.percentile(error, 99) <= 0.05
    t = reference.transmittance(rays, medium, lights, occluders)
    lit = np.isfinite(t) & ~lamp[:, None]
    error = np.abs(read_map(build.transmittance).reshape(-1, 3) / np.where(lit, t, 1) - 1)[lit]
    assert np.median(error) <= 0.005 and np.percentile(error, 99) <= 0.05


def test_composite_is_the_papers_equation(tmp_path):
    build = chain(tmp_path, {"point": DESCRIBED["point"]})
    expected = 0.5 * read_map(build.transmittance) + read_map(build.in_scattering())
    np.testing.assert_allclose(read_map(build.foggy(".exr")), expected, rtol=1e-6)
    assert read_metadata(build.foggy(".exr"))["fog:medium"] == "homogeneous"
    t = read_map(build.transmittance)
    assert np.isfinite(t).all() and t.min() > 0 and t.max() < 1


def test_relighting_equals_rendering_again(tmp_path):
    lights = {"point": DESCRIBED["point"], "area": {**DESCRIBED["area"], "sub_lights": 2}}
    # a plan would choose by the lights' strengths
    knobs = {"samples": 24, "in_scattering_size": 256, "glow_tolerance": 5e-3, "shadow_size": 128, "shadow_lights": 5,
             "transmittance": "area"}
    build = chain(tmp_path, lights, box=True, render=knobs)

    def times():
        return {path: path.stat().st_mtime_ns for path in build.runs.glob("*.exr")}

    before = times()
    run(build, "lights.point.gain=2.5", stages=("resolve", "decompose", "composite"))
    assert times() == before, "nothing is rendered"
    relit = [read_map(path) for path in (build.transmittance, build.in_scattering(), build.foggy(".exr"))]

    brighter = {**lights, "point": {**lights["point"], "intensity": [2.5 * x for x in COLOUR]}}
    again = chain(tmp_path / "again", brighter, box=True, render=knobs)
    for path, one in zip((again.transmittance, again.in_scattering(), again.foggy(".exr")), relit):
        np.testing.assert_allclose(one, read_map(path), rtol=5e-3)  # half a per cent is what was promised


def test_one_pass_agrees(tmp_path):
    lights = {kind: DESCRIBED[kind] for kind in ("point", "sun")}
    build = chain(tmp_path, {**lights, "area": {**DESCRIBED["area"], "sub_lights": 3}}, box=True)
    run(build, stages=("closure",))
    facts = json.loads((build.out / "closure.json").read_text())
    assert facts["median_relative_difference"] <= 0.01, facts


def test_units_of_the_renderer_do_not_show(tmp_path):
    lights = {"point": DESCRIBED["point"], "sun": DESCRIBED["sun"]}
    build = chain(tmp_path, lights, box=True)
    maps = [read_map(path) for path in (build.transmittance, build.in_scattering())]
    run(build, "exporter.units_per_metre=3")
    assert "Metre       = 3.0" in (build.pov / "in_scattering_sun.pov").read_text()
    for path, before in zip((build.transmittance, build.in_scattering()), maps):
        # tolerances of 1e-3 units move shadow edges by up to a sample of a few rays
        assert np.median(np.abs(read_map(path) / before - 1)) < 1e-3


def test_the_plan_says_why(tmp_path):
    lights = {"point": DESCRIBED["point"], "reflected": {"type": "ambient", "radiance": COLOUR}}
    build = chain(tmp_path, lights)
    said = json.loads(build.plan.read_text())["reasons"]
    assert "reflected: known in closed form, no render" in said and "no sun: no shaft" in said
    assert said[0].startswith("asked for quality final, a tolerance of 0.002: expects"), said
    assert any(line.startswith("chosen for that: in_scattering_size") for line in said), said
    # nothing stands in the room: no render at all
    assert json.loads(build.plan.read_text())["runs"] == []
    run(build, "render.glow=rendered", "render.shaft_samples=9", "fog.absorption_coefficient=[50,50,50]",
        stages=("resolve", "plan"))
    said = json.loads(build.plan.read_text())["reasons"]
    assert "as the scene states: shaft_samples" in said, said
    assert "point: 36 samples instead of 9: dense fog, 0.33 optical depths each" in said, said


def test_a_render_that_takes_too_long_is_stopped(tmp_path, capsys):
    build = chain(tmp_path, {"point": DESCRIBED["point"]})
    capsys.readouterr()
    for path in build.basis.glob("irradiance_*.sha256"):
        path.unlink()
    run(build, "render.timeout=0.001", stages=("resolve",))
    assert main(["illumination", "--scene", build.scene, "--scenes", str(build.scenes),
                 "--build", str(build.builds)]) == 2
    assert "longer than 0.001 s" in capsys.readouterr().err
