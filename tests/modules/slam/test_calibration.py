from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from modules.slam import calibration
from modules.slam.calibration import CalibrationError, Rectifier, load_camera, load_rig

RIG = Path(calibration.__file__).parent / "rig"


def test_the_robots_rig_has_its_baseline():
    assert Rectifier(load_rig(RIG)).baseline == pytest.approx(0.11, abs=1e-6)


def test_rectified_rotations_stay_rotations():
    rotation = Rectifier(load_rig(RIG)).body_from_camera[:3, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-6)


def test_a_file_with_opencvs_first_line_is_read(tmp_path):
    original = RIG / "cam0/sensor.yaml"
    copy = tmp_path / "sensor.yaml"
    copy.write_text("%YAML:1.0\n" + original.read_text(encoding="utf-8"), encoding="utf-8")
    assert load_camera(copy).size == (752, 480)


@pytest.mark.parametrize(
    ("old", "new"),
    [("pinhole", "omni"), ("radial-tangential", "equidistant"), ("intrinsics", "x"), ("[752, 480]", "7")],
)
def test_another_kind_of_camera_is_refused(tmp_path, old, new):
    text = (RIG / "cam0/sensor.yaml").read_text(encoding="utf-8")
    copy = tmp_path / "sensor.yaml"
    copy.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CalibrationError, match=r"sensor\.yaml"):
        load_camera(copy)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match="cam0"):
        load_rig(tmp_path)
