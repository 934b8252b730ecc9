from __future__ import annotations

import pytest

from robotkit import euroc
from robotkit.euroc import DatasetError, Row, TruePose

START = 1403636579763555584


@pytest.fixture
def imu0(tmp_path):
    folder = tmp_path / "MH_01_easy/mav0/imu0"
    folder.mkdir(parents=True)
    return folder


def test_both_ways_to_unpack_are_found(imu0):
    (imu0 / "data.csv").write_text("")
    assert euroc.find(imu0.parent.parent) == imu0.parent
    assert euroc.find(imu0.parent) == imu0.parent


def test_a_folder_without_a_sequence_is_named(tmp_path):
    with pytest.raises(DatasetError, match="no EuRoC sequence"):
        euroc.find(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "{0},1,2\n",
        "#timestamp [ns],x,y\r\n{0},1,2\r\n\r\n",
        "\ufeff#timestamp [ns],x,y\n{0},1,2\n",
        "\ufeff{0},1,2\n",
        " # recorded in the machine hall\n# by hand\n{0}, 1, 2\n",
    ],
)
def test_files_as_they_are_found(imu0, text):
    (imu0 / "data.csv").write_text(text.format(START), encoding="utf-8", newline="")
    assert list(euroc.rows(imu0)) == [Row(START, ["1", "2"])]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"when,x\n", r"line 1: invalid value 'when': expected a time in ns"),
        (b"1,2,3,4,5,6\n", r"row 1: invalid value '2,3,4,5,6': expected 6 numbers"),
        (b"1,2,3,4,5,6,nan\n", r"6 numbers"),
        (b"1,2,3,4,5,6,x\n", r"6 numbers"),
        (b"\xff\xfe\x00", r"cannot be read"),
        (None, r"cannot be read"),
    ],
)
def test_an_invalid_file_is_named_with_its_row(imu0, content, expected):
    if content is not None:
        (imu0 / "data.csv").write_bytes(content)
    with pytest.raises(DatasetError, match=expected) as caught:
        list(euroc.imu(imu0.parent))
    assert "imu0/data.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("row", "velocity"), [("1,2,3,1,0,0,0", None), ("1,2,3,1,0,0,0,4,5,6,0,0,0,0,0,0", (4.0, 5.0, 6.0))]
)
def test_ground_truth_with_and_without_velocity(imu0, row, velocity):
    truth = imu0.parent / euroc.TRUTH
    truth.mkdir()
    (truth / "data.csv").write_text(f"{START},{row}\n")
    assert euroc.truth(imu0.parent) == [TruePose(START, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), velocity)]


def test_a_sequence_without_ground_truth(imu0):
    assert euroc.truth(imu0.parent) is None


def test_speed_from_the_path_at_its_ends_and_in_its_middle():
    path = [TruePose(START + second * 10**9, (x, 0.0, 0.0), (1.0, 0, 0, 0), None) for second, x in enumerate((0, 1, 3))]
    assert euroc.speeds(path) == [1.0, 1.5, 2.0]
    assert euroc.speeds(path[:1]) == [0.0]


def test_a_picture_without_its_partner_is_left_out(tmp_path):
    for camera, names in (("cam0", "123"), ("cam1", "13")):
        (tmp_path / camera / "data").mkdir(parents=True)
        (tmp_path / camera / "data.csv").write_text("".join(f"{name},{name}.png\n" for name in "123"))
        for name in names:
            (tmp_path / camera / "data" / f"{name}.png").write_bytes(camera.encode())
    assert [frame.stamp for frame in euroc.stereo(tmp_path)] == [1, 3]
    assert list(euroc.pictures(tmp_path, "cam1")) == [(1, b"cam1"), (3, b"cam1")]
