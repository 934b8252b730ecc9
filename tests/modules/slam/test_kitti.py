from __future__ import annotations

import cv2
import numpy as np
import pytest

from modules.slam import kitti
from modules.slam.calibration import Rectifier
from modules.slam.sequences import recording
from modules.slam.trajectory import load
from robotkit import ConfigurationError

LEFT = "700 0 60 0 0 700 20 0 0 0 1 0"
RIGHT = "700 0 60 -350 0 700 20 0 0 0 1 0"
AHEAD = "1 0 0 0.5 0 1 0 -0.25 0 0 1 2"  # of the camera: right, up, ahead
POSES = f"1 0 0 0 0 1 0 0 0 0 1 0\n{AHEAD}\n{AHEAD}\n"


def write(folder, names=("image_0", "image_1"), calibration=f"P0: {LEFT}\nP1: {RIGHT}\n", poses=POSES, count=3):
    for name in names:
        (folder / name).mkdir(parents=True)
        for number in range(count):
            cv2.imwrite(str(folder / name / f"{number:06d}.png"), np.full((40, 120), number, np.uint8))
    (folder / "calib.txt").write_text(calibration, encoding="utf-8")
    if poses:
        (folder / "poses.txt").write_text(poses, encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("names", "calibration"),
    [
        (("image_0", "image_1"), f"P0: {LEFT}\nP1: {RIGHT}\nTr: 1 2 3\n"),
        (("image_l", "image_r"), f"{LEFT}\n{RIGHT}"),
        (
            ("image_2", "image_3"),
            f"P0: {LEFT}\nP1: {LEFT}\nP2: 700 0 60 42 0 700 20 0 0 0 1 0\nP3: 700 0 60 -308 0 700 20 0 0 0 1 0\n",
        ),
    ],
)
def test_both_cameras_are_read_as_the_benchmark_and_its_extracts_have_them(tmp_path, names, calibration):
    rectifier = Rectifier(recording(write(tmp_path, names, calibration)).rig)
    assert rectifier.baseline == pytest.approx(0.5)
    assert rectifier.size == (120, 40)
    assert rectifier.matrix[0, 0] == pytest.approx(700, rel=0.01)


def test_pictures_have_the_times_of_the_sequence_or_come_ten_times_a_second(tmp_path):
    write(tmp_path)
    assert [frame.stamp for frame in recording(tmp_path).frames] == [0, 100_000_000, 200_000_000]
    (tmp_path / "times.txt").write_text("0\n1.037e-01\n2.0e-01\n", encoding="utf-8")
    assert [frame.stamp for frame in recording(tmp_path).frames] == [0, 103_700_000, 200_000_000]


def test_a_left_picture_without_a_right_one_is_skipped(tmp_path):
    (write(tmp_path) / "image_1/000001.png").unlink()
    assert [frame.stamp for frame in recording(tmp_path).frames] == [0, 200_000_000]


def test_true_poses_are_the_bodys_and_may_lie_where_the_benchmark_has_them(tmp_path):
    sequence = write(tmp_path / "sequences/07", poses="")
    assert kitti.truth(sequence) is None
    (tmp_path / "poses").mkdir()
    (tmp_path / "poses/07.txt").write_text(POSES, encoding="utf-8")
    assert load(sequence).positions[1] == pytest.approx([2, -0.5, 0.25])  # ahead, left, up
    assert load(sequence).orientations[1] == pytest.approx([0, 0, 0, 1])


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"calibration": "P0: 1 2\n"}, r"calib\.txt: invalid line 'P0: 1 2': expected 12 numbers"),
        ({"calibration": f"P0: {LEFT}\n"}, "1 projections, expected two or more"),
        ({"calibration": f"{LEFT}\n{LEFT.replace('700', 'nan')}"}, "expected 12 numbers"),
        ({"count": 0}, "no pictures"),
        ({"poses": POSES + AHEAD}, "4 poses, expected one for each of 3 pictures"),
        ({"poses": ""}, "no ground truth"),
    ],
)
def test_a_broken_sequence_is_one_clear_error(tmp_path, change, expected):
    write(tmp_path, **change)
    with pytest.raises(ConfigurationError, match=expected):
        (recording(tmp_path), load(tmp_path))


def test_too_few_times_and_pictures_that_cannot_be_decoded_are_errors(tmp_path):
    write(tmp_path)
    (tmp_path / "times.txt").write_text("0\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"times\.txt: 1 times, expected one for each of 3 pictures"):
        list(recording(tmp_path).frames)
    (tmp_path / "image_0/000000.png").write_bytes(b"noise")
    with pytest.raises(ConfigurationError, match="cannot be decoded"):
        recording(tmp_path)
