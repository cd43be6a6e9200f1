"""Renders the reference of tests/test_multiple_scattering.py with Mitsuba 3: all orders of scattering.

A closed room, 3 x 2.4 x 4.6 m, albedo (.6, .5, .4), one Lambertian lamp under the ceiling, isotropic fog that
absorbs nothing. Needs the `mitsuba` package, which the project otherwise does without:

    python tests/reference/multiple_scattering/render.py      (some minutes)
"""

from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
LOWER, UPPER = np.array([-1.5, 0, -3]), np.array([1.5, 2.4, 1.6])
LAMP = np.array([[-0.25, 2.39, -1.7], [0.25, 2.39, -1.7], [0.25, 2.39, -1.3], [-0.25, 2.39, -1.3]])
SAMPLES = 512


def rectangle(corners, bsdf, radiance=None):
    a, b = corners[1] - corners[0], corners[3] - corners[0]
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = a / 2, b / 2
    matrix[:3, 2], matrix[:3, 3] = np.cross(a, b) / np.linalg.norm(np.cross(a, b)), corners.mean(0)
    shape = {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix), "bsdf": bsdf}
    if radiance:
        shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": radiance}}
    return shape


def walls():
    paint = {"type": "twosided",
             "side": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.5, 0.4]}}}
    bounds = np.stack([LOWER, UPPER])
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for side in range(2):
            corners = np.empty((4, 3))
            corners[:, axis] = bounds[side, axis]
            corners[:, i] = bounds[[0, 1, 1, 0], i]
            corners[:, j] = bounds[[0, 0, 1, 1], j]
            yield f"wall_{axis}{side}", rectangle(corners, paint)


def render(scattering_coefficient):
    scene = {"type": "scene", **dict(walls()),
             "lamp": rectangle(LAMP, {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}, [17.0, 12.0, 7.0]),
             "integrator": {"type": "volpath" if scattering_coefficient else "path", "max_depth": 80, "rr_depth": 50}}
    sensor = {"type": "perspective", "fov": 65, "fov_axis": "x",
              "to_world": mi.ScalarTransform4f().look_at(origin=[0.03, 1.43, 1.3], target=[0.02, 1.1, -2], up=[0, 1, 0]),
              "film": {"type": "hdrfilm", "width": 48, "height": 36, "rfilter": {"type": "box"}},
              "sampler": {"type": "independent", "sample_count": SAMPLES}}
    if scattering_coefficient:
        scene["fog"] = {"type": "homogeneous", "sigma_t": scattering_coefficient, "albedo": 1.0,
                        "phase": {"type": "isotropic"}}
        sensor["medium"] = {"type": "ref", "id": "fog"}
        place = mi.ScalarTransform4f().translate(list((LOWER + UPPER) / 2)).scale(list((UPPER - LOWER) / 2 + 1))
        scene["bounds"] = {"type": "cube", "to_world": place, "bsdf": {"type": "null"},
                           "interior": {"type": "ref", "id": "fog"}}
    scene["sensor"] = sensor
    return mi.render(mi.load_dict(scene))


if __name__ == "__main__":
    for name, coefficient in (("clear", 0.0), ("fog_0.1", 0.1), ("fog_0.3", 0.3)):
        bitmap = mi.Bitmap(render(coefficient)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float16)
        bitmap.write(str(Path(__file__).parent / f"{name}.exr"))
