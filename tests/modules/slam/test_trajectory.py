from __future__ import annotations

import numpy as np
import pytest

from modules.slam.trajectory import TrajectoryError, associate, load, save, trajectory
from timelines.datasets import euroc
from timelines.datasets.motion import Motion

START = 1_403_636_579_763_555_584
IDENTITY = (0.0, 0, 0, 1)


def path(*stamps):
    return trajectory((stamp, (float(index), 0, 0, *IDENTITY)) for index, stamp in enumerate(stamps))


def test_saved_values_round_trip_exactly(tmp_path):
    poses = trajectory([(START + 1, (1.5, -2, 3, 0, 0, 0.6, 0.8)), (START, (0, 0, 0, *IDENTITY))])
    save(tmp_path / "poses.tum", poses)
    first, second = (tmp_path / "poses.tum").read_text().splitlines()
    assert first.startswith("1403636579.763555584 0.000000000 ")
    assert second.split()[4:] == ["0.000000000", "0.000000000", "0.600000000", "0.800000000"]
    again = load(tmp_path / "poses.tum")
    assert again.stamps.tolist() == [START, START + 1]
    assert again.positions.tolist() == [[0, 0, 0], [1.5, -2, 3]]


def test_comments_blank_lines_and_crlf_are_accepted(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbf# timestamp tx\r\n\r\n1.5 1 2 3 0 0 0 1\r\n1e-1 0 0 0 0 0 0 2\r\n")
    assert load(tmp_path / "a").stamps.tolist() == [100_000_000, 1_500_000_000]


@pytest.mark.parametrize(
    "line",
    [
        "1 2 3",
        "1 1 2 3 0 0 0 x",
        "1 1 2 nan 0 0 0 1",
        "1 1 2 3 0 0 0 0",
        "inf 1 2 3 0 0 0 1",
        "1 1 2 3 0 0 0 1 9",
        "\0",
    ],
)
def test_an_invalid_pose_is_reported_with_its_line(tmp_path, line):
    (tmp_path / "a.tum").write_text(f"# ok\n1 1 2 3 0 0 0 1\n{line}\n")
    with pytest.raises(TrajectoryError, match=r"a\.tum: line 3: invalid value "):
        load(tmp_path / "a.tum")


def test_missing_empty_and_binary_files_are_refused(tmp_path):
    (tmp_path / "empty").write_text("# nothing\n")
    (tmp_path / "picture").write_bytes(b"\x89PNG\xff\xfe")
    for name, expected in (("missing", "cannot be read"), ("empty", "no poses"), ("picture", "cannot be read")):
        with pytest.raises(TrajectoryError, match=expected):
            load(tmp_path / name)


def test_the_ground_truth_of_a_sequence(tmp_path):
    euroc.write_inertial(tmp_path, euroc.Sequence(Motion(1, ((0, 1),))))
    truth = load(tmp_path)
    assert len(truth) == 200
    assert truth.orientations[0] == pytest.approx([0, 0, 0, 1])
    assert truth.poses[0] == pytest.approx(np.eye(4))


def test_each_pose_of_the_shorter_one_gets_the_nearest_of_the_longer_one():
    ms = 1_000_000
    poses, truth = associate(path(3 * ms, 21 * ms), path(0, 5 * ms, 10 * ms, 15 * ms, 20 * ms))
    assert poses.stamps.tolist() == [3 * ms, 21 * ms]
    assert truth.stamps.tolist() == [5 * ms, 20 * ms]


def test_poses_before_and_after_the_ground_truth_are_left_out():
    ms = 1_000_000
    poses, truth = associate(path(*range(0, 100 * ms, 5 * ms)), path(40 * ms, 50 * ms))
    assert poses.stamps.tolist() == [40 * ms, 50 * ms]
    assert truth.stamps.tolist() == [40 * ms, 50 * ms]
    assert [len(one) for one in associate(path(0, ms), path(500 * ms))] == [0, 0]
