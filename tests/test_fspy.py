"""fSpy's JSON, written here from a known camera, comes back as that camera."""

import json

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, rotation
from pipeline.geometry.fspy import camera_from_fspy


def known_camera(portrait=False, yaw=20.0):
    width, height = (3024, 4032) if portrait else (4032, 3024)
    return Camera(
        width,
        height,
        3500.0,
        np.array([width * 0.45, height * 0.56]),
        rotation(yaw, -12, 3),
        np.array([0.7, 1.6, -0.4]),
    )


def exported(camera, up="z"):
    """What fSpy writes for this camera: image frame of half the longer side; y up, z backwards."""
    # our (x, y, z) is (x, -z, y) of a world with z up
    fspy_from_ours = {"z": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), "y": np.eye(3)}[up]
    transform = np.eye(4)
    right, down, forward = camera.world_from_camera.T
    transform[:3, :3] = fspy_from_ours @ np.stack([right, -down, -forward], 1)
    transform[:3, 3] = fspy_from_ours @ camera.position
    half = max(camera.width, camera.height) / 2
    cx, cy = camera.principal_point
    return {
        "principalPoint": {"x": (cx - camera.width / 2) / half, "y": -(cy - camera.height / 2) / half},
        "viewTransform": {"rows": np.linalg.inv(transform).tolist()},
        "cameraTransform": {"rows": transform.tolist()},
        "horizontalFieldOfView": 2 * np.arctan(camera.width / 2 / camera.focal_length),
        "verticalFieldOfView": 2 * np.arctan(camera.height / 2 / camera.focal_length),
        "relativeFocalLength": camera.focal_length / half,
        "imageWidth": camera.width,
        "imageHeight": camera.height,
    }


@pytest.mark.parametrize("portrait", [False, True])
@pytest.mark.parametrize("up", ["y", "z"])
def test_known_camera_comes_back(portrait, up):
    camera = known_camera(portrait)
    found = camera_from_fspy(json.dumps(exported(camera, up)).encode(), up=up)
    points = np.array([[0, 0, -4], [1, 2, -6], [-1, 0.5, -3.0]])
    # through the pixels, so that every convention is in it; rounding of pixels near 4000
    np.testing.assert_allclose(found.project(points)[0], camera.project(points)[0], atol=1e-8)
    np.testing.assert_allclose(found.position, camera.position, atol=1e-12)
    assert (found.width, found.height) == (camera.width, camera.height)


def test_world_origin_and_axes_of_a_real_layout():
    """A camera 10 units from the origin sees it where the view transform's last column says."""
    camera = known_camera()
    parameters = exported(camera)
    origin = np.array(parameters["viewTransform"]["rows"])[:3, 3]  # x right, y up, z backwards
    half = camera.width / 2
    plane = origin[:2] / -origin[2] * parameters["relativeFocalLength"] + [
        parameters["principalPoint"][k] for k in "xy"
    ]
    pixel = [camera.width / 2 + half * plane[0], camera.height / 2 - half * plane[1]]
    found = camera_from_fspy(parameters)
    seen = found.project(np.zeros(3))[0]
    if origin[2] < 0:
        np.testing.assert_allclose(seen, pixel, atol=1e-6)
    else:
        assert np.isnan(seen).all()


@pytest.mark.parametrize("yaw, quarter", [(20, 0), (100, 90), (-80, -90), (170, 180), (215, 180)])
def test_quarter_turns_bring_the_view_to_minus_z(yaw, quarter):
    camera = known_camera(yaw=yaw)
    found = camera_from_fspy(exported(camera))
    np.testing.assert_allclose(found.world_from_camera, rotation(yaw - quarter, -12, 3), atol=1e-12)
    back = rotation(quarter) @ rotation().T
    np.testing.assert_allclose(back @ found.position, camera.position, atol=1e-12)


def test_view_transform_alone_and_a_camera_height():
    camera = known_camera()
    parameters = exported(camera)
    del parameters["cameraTransform"]
    found = camera_from_fspy(parameters, camera_height=3.2)
    np.testing.assert_allclose(found.position, camera.position * 2, atol=1e-12)
    np.testing.assert_allclose(found.world_from_camera, camera.world_from_camera, atol=1e-12)


def changed(**values):
    parameters = exported(known_camera())
    for key, value in values.items():
        if value is None:
            del parameters[key]
        else:
            parameters[key] = value
    return parameters


@pytest.mark.parametrize(
    "parameters, message",
    [
        ([1, 2], "holds no fSpy camera; export it again"),
        (changed(imageWidth=None), "imageWidth is missing"),
        (changed(imageWidth="wide"), "imageWidth is 'wide', not a number"),
        (changed(imageHeight=0), "image size is 4032 x 0"),
        (changed(horizontalFieldOfView=4.0), "horizontalFieldOfView is 4 rad"),
        (changed(relativeFocalLength=1.0), "relativeFocalLength 1 contradicts horizontalFieldOfView"),
        (changed(principalPoint=None), "principalPoint is missing"),
        (changed(principalPoint={"x": 0}), "principalPoint.y is missing"),
        (changed(cameraTransform=None, viewTransform=None), "cameraTransform is missing"),
        (changed(cameraTransform={"rows": [[1, 0], [0, 1]]}), "cameraTransform.rows is not a 4 x 4 matrix"),
        (
            changed(cameraTransform={"rows": [[1, 0, 0, "a"]] * 4}),
            "cameraTransform.rows is not a 4 x 4 matrix",
        ),
        (changed(cameraTransform={"rows": (2 * np.eye(4)).tolist()}), "cameraTransform is not a rotation"),
        (
            changed(cameraTransform={"rows": np.diag([1.0, 1, -1, 1]).tolist()}),
            "cameraTransform is not a rotation",
        ),
    ],
)
def test_bad_parameters_are_refused(parameters, message):
    with pytest.raises(InputError, match=message):
        camera_from_fspy(parameters)


def test_wrong_up_axis_is_refused_with_the_right_one():
    with pytest.raises(InputError, match="with z up the camera .*(up: y|other up axis)"):
        camera_from_fspy(exported(known_camera(), up="y"), up="z")
    with pytest.raises(InputError, match="fSpy up axis 'x'"):
        camera_from_fspy(exported(known_camera()), up="x")
    below = known_camera()
    below.position[1] = -0.5
    with pytest.raises(InputError, match="at height -0.5 with z up, not above the floor"):
        camera_from_fspy(exported(below))


def test_other_files_are_refused_in_one_line():
    with pytest.raises(InputError, match="is not JSON") as refusal:
        camera_from_fspy(b"\x66\x73\x70\x79\x01\x00\x00\x00\xff\xfe")
    assert "\n" not in str(refusal.value)
    with pytest.raises(InputError, match="imageWidth is missing"):
        camera_from_fspy(b"{}")
