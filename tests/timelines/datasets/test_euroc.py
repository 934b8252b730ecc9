from __future__ import annotations

import cv2
import numpy as np
import pytest
import yaml

from modules.slam.calibration import Rectifier, load_rig
from modules.slam.features import Picture, measure
from robotkit.euroc import rows as euroc_rows
from timelines.datasets import corridor, euroc
from timelines.datasets.motion import Motion

SEQUENCE = euroc.Sequence(Motion(duration=0.3, moving=((0, 0.3),)))


def a_sequence(folder):
    euroc.write(folder, SEQUENCE, progress=lambda _: None)
    return folder / "mav0"


@pytest.fixture(scope="module")
def mav0(tmp_path_factory):
    return a_sequence(tmp_path_factory.mktemp("euroc"))


def test_the_folders_are_those_of_euroc(mav0):
    assert {path.name for path in mav0.iterdir()} == {"cam0", "cam1", "imu0", "state_groundtruth_estimate0"}


@pytest.mark.parametrize(
    ("sensor", "rows", "columns", "first"),
    [
        ("cam0", 3, 2, "#timestamp [ns],filename"),
        ("imu0", 60, 7, "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y"),
        ("state_groundtruth_estimate0", 60, 17, "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w []"),
    ],
)
def test_a_sensors_rows(mav0, sensor, rows, columns, first):
    table = list(euroc_rows(mav0 / sensor))
    assert len(table) == rows
    assert {1 + len(values) for _, values in table} == {columns}
    assert table[0][0] == euroc.EPOCH_NS
    assert (mav0 / sensor / "data.csv").read_text(encoding="utf-8").startswith(first)


def test_pictures_are_gray_and_named_by_their_stamp(mav0):
    for stamp, (name,) in euroc_rows(mav0 / "cam1"):
        assert name == f"{stamp}.png"
        picture = cv2.imread(str(mav0 / "cam1/data" / name), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        assert picture.shape == (480, 752)
        assert picture.dtype == np.uint8


def test_sensor_files_are_yaml(mav0):
    imu = yaml.safe_load((mav0 / "imu0/sensor.yaml").read_text(encoding="utf-8"))
    assert imu["rate_hz"] == 200
    assert len(imu["T_BS"]["data"]) == 16


def first_picture(camera):
    picture = cv2.imread(str(min((camera / "data").glob("*.png"))), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    return picture


def depths(mav0):
    """Places of the first pictures' corners in the rectified left camera's frame."""
    rectifier = Rectifier(load_rig(mav0))
    left, right = (first_picture(mav0 / camera) for camera in ("cam0", "cam1"))
    picture = Picture(rectifier.left(left), 800)
    disparities = measure(picture, Picture(rectifier.right(right), 800))
    known = np.isfinite(disparities)
    return rectifier.in_space(picture.features.pixels[known], disparities[known])


def test_stereo_depth_is_that_of_the_corridor(mav0):
    points = depths(mav0)
    assert len(points) > 300
    end_wall = points[(np.abs(points[:, 0]) < 0.5) & (np.abs(points[:, 1]) < 0.5)][:, 2]
    assert np.median(end_wall) == pytest.approx(4.9, abs=0.25)


def test_a_block_hides_what_is_behind_it(tmp_path):
    hall = corridor.Hall((-2, -1.6), (6, 1.6), (((3, 0), (4, 1)),))
    euroc.write(tmp_path, euroc.Sequence(Motion(0.1, ()), hall=hall), progress=lambda _: None)
    points = depths(tmp_path / "mav0")  # the camera is 0.1 m ahead of the origin, 0.055 m to its left
    ahead = points[np.abs(points[:, 1]) < 0.4]
    on_block = ahead[(ahead[:, 0] < -0.05) & (ahead[:, 0] > -0.85) & (ahead[:, 2] > 1)]
    beside = ahead[(ahead[:, 0] > 0.2) & (ahead[:, 0] < 1.2) & (ahead[:, 2] > 1)]
    assert np.median(on_block[:, 2]) == pytest.approx(2.9, abs=0.15)
    assert np.median(beside[:, 2]) == pytest.approx(5.9, abs=0.4)


def test_the_same_seed_gives_the_same_files(mav0, tmp_path):
    again = a_sequence(tmp_path)
    files = [path.relative_to(mav0) for path in mav0.rglob("*") if path.is_file()]
    assert len(files) == 14
    assert [file for file in files if (mav0 / file).read_bytes() != (again / file).read_bytes()] == []
