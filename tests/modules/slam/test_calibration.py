from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from modules.slam import calibration
from modules.slam.calibration import CalibrationError, Camera, Rectifier, Rig, load_camera, load_rig

RIG = Path(calibration.__file__).parent / "rig"


def test_the_robots_rig_has_its_baseline():
    assert Rectifier(load_rig(RIG)).baseline == pytest.approx(0.11, abs=1e-6)


def test_rectified_rotations_stay_rotations():
    rotation = Rectifier(load_rig(RIG)).body_from_camera[:3, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-6)


@pytest.mark.parametrize("before", ["%YAML:1.0\n", "\ufeff", "\ufeff%YAML:1.0\n", "# by hand\n%YAML:1.0\n---\n"])
def test_byte_order_mark_and_yaml_header_are_skipped(tmp_path, before):
    original = RIG / "cam0/sensor.yaml"
    copy = tmp_path / "sensor.yaml"
    copy.write_text(before + original.read_text(encoding="utf-8"), encoding="utf-8")
    assert load_camera(copy).size == (752, 480)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("pinhole", "omni"),
        ("radial-tangential", "fov"),
        ("intrinsics", "x"),
        ("[752, 480]", "7"),
        (", 0.0000176187114", ""),
        ("458.654", ".nan"),
        ("458.654", "-1"),
        ("0.055", ".inf"),
    ],
)
def test_another_kind_of_camera_is_refused(tmp_path, old, new):
    text = (RIG / "cam0/sensor.yaml").read_text(encoding="utf-8")
    copy = tmp_path / "sensor.yaml"
    copy.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CalibrationError, match=r"sensor\.yaml"):
        load_camera(copy)


def test_cameras_that_are_not_side_by_side_are_refused():
    rig = load_rig(RIG)
    for right in (rig.left, replace(rig.right, body_from_camera=rig.left.body_from_camera)):
        with pytest.raises(CalibrationError, match="right of cam0"):
            Rectifier(replace(rig, right=right))
    with pytest.raises(CalibrationError, match="right of cam0"):
        Rectifier(replace(rig, left=rig.right, right=rig.left))


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match="cam0"):
        load_rig(tmp_path)


def camchain(rig, *, model="radtan", imu=True):
    """The rig as Kalibr would write it."""
    cameras = {}
    for name, camera in (("cam0", rig.left), ("cam1", rig.right)):
        (fu, _, cu), (_, fv, cv), _ = camera.matrix.tolist()
        cameras[name] = {
            "camera_model": "pinhole",
            "intrinsics": [fu, fv, cu, cv],
            "distortion_model": model,
            "distortion_coeffs": camera.distortion.tolist(),
            "resolution": list(camera.size),
            "rostopic": f"/{name}/image_raw",
        }
    if imu:
        cameras["cam0"]["T_cam_imu"] = np.linalg.inv(rig.left.body_from_camera).tolist()
    cameras["cam1"]["T_cn_cnm1"] = (np.linalg.inv(rig.right.body_from_camera) @ rig.left.body_from_camera).tolist()
    return cameras


def test_a_kalibr_camchain_is_the_same_rig(tmp_path):
    rig = load_rig(RIG)
    (tmp_path / "robot-camchain-imucam.yaml").write_text(yaml.safe_dump(camchain(rig)), encoding="utf-8")
    same = load_rig(tmp_path)
    for mine, theirs in ((same.left, rig.left), (same.right, rig.right)):
        assert mine.matrix == pytest.approx(theirs.matrix)
        assert mine.distortion == pytest.approx(theirs.distortion)
        assert mine.body_from_camera == pytest.approx(theirs.body_from_camera, abs=1e-12)


def test_without_an_imu_the_body_is_the_left_camera(tmp_path):
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(camchain(load_rig(RIG), imu=False)), encoding="utf-8")
    rig = load_rig(tmp_path)
    assert (rig.left.body_from_camera @ [0, 0, 1, 1]).tolist() == [1, 0, 0, 1]  # what is ahead of the lens is ahead
    assert Rectifier(rig).baseline == pytest.approx(0.11, abs=1e-6)


@pytest.mark.parametrize(("model", "fisheye"), [("radtan", False), ("equidistant", True)])
def test_a_point_has_the_same_row_in_both_rectified_pictures(tmp_path, model, fisheye):
    coefficients = [-0.02, 0.005, -0.003, 0.001] if fisheye else [-0.28, 0.07, 0.0002, 0.00002]
    chain = camchain(load_rig(RIG), model=model)
    for camera in chain.values():
        camera["distortion_coeffs"] = coefficients
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(chain), encoding="utf-8")
    rig = load_rig(tmp_path)
    assert (rig.left.fisheye, rig.right.fisheye) == (fisheye, fisheye)
    rectifier = Rectifier(rig)
    dots = np.array([[4.0, 0.6, 0.3], [3.0, -0.5, -0.4], [5.0, 0.2, 0.5]])  # in the body's frame
    left, right = (
        [centre(rectify(drawn(camera, dot))) for dot in dots]
        for camera, rectify in ((rig.left, rectifier.left), (rig.right, rectifier.right))
    )
    for (x_left, y_left), (x_right, y_right), (depth, _, _) in zip(left, right, dots, strict=True):
        assert y_left == pytest.approx(y_right, abs=0.3)
        distance = rectifier.matrix[0, 0] * rectifier.baseline / (x_left - x_right)
        assert distance == pytest.approx(depth - 0.1, rel=0.03)  # the lens is 10 cm ahead of the body's origin


def test_pictures_that_are_rectified_already_are_taken_as_they_are():
    body_from_camera = load_rig(RIG).left.body_from_camera
    left = Camera(np.array([[700.0, 0, 601.3], [0, 700, 183.2], [0, 0, 1]]), np.zeros(4), body_from_camera, (1226, 370))
    beside = body_from_camera @ np.array([[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    rectifier = Rectifier(Rig(left, replace(left, body_from_camera=beside)))
    picture = np.zeros((370, 1226), np.uint8)
    assert rectifier.left(picture) is picture
    assert rectifier.right(picture) is picture


def drawn(camera, dot):
    """A blurred dot where the lens shows it."""
    place = (np.linalg.inv(camera.body_from_camera) @ [*dot, 1])[:3].reshape(1, 1, 3)
    project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    pixel = project(place, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0].ravel()
    rows, columns = np.mgrid[0 : camera.size[1], 0 : camera.size[0]]
    return (255 * np.exp(-((columns - pixel[0]) ** 2 + (rows - pixel[1]) ** 2) / 18)).astype(np.uint8)


def centre(image):
    weights = image.astype(float)
    rows, columns = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    return (columns * weights).sum() / weights.sum(), (rows * weights).sum() / weights.sum()


@pytest.mark.parametrize(
    ("change", "expected"), [({"distortion_model": "fov"}, "radtan, equidistant"), ({"T_cn_cnm1": 1}, "camchain")]
)
def test_an_invalid_camchain_is_refused(tmp_path, change, expected):
    chain = camchain(load_rig(RIG))
    chain["cam1"] |= change
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(chain), encoding="utf-8")
    with pytest.raises(CalibrationError, match=expected):
        load_rig(tmp_path)


def test_different_lens_models_are_refused():
    rig = load_rig(RIG)
    with pytest.raises(CalibrationError, match="differ"):
        Rectifier(replace(rig, right=replace(rig.right, fisheye=True)))
