"""How exact the odometry is, on pictures whose truth is known; the same pictures give the same figures everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from modules.slam.calibration import Rectifier, load_rig
from modules.slam.odometry import Odometry
from modules.slam.task import Slam
from robotkit import UNPLANNED, Decision, MessageError, Received
from robotkit.stereo import StereoFrame, encode
from tests.modules.slam.accuracy import trajectory_rmse
from timelines.datasets import euroc
from timelines.datasets.motion import Motion
from timelines.datasets.readers import positions, read

STILL_FRAMES = 5


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    root = tmp_path_factory.mktemp("datasets")
    motion = Motion(duration=5, moving=((0.5, 4.5),))
    euroc.write(root / "short", euroc.Sequence(motion), progress=lambda _: None)
    return root


@pytest.fixture(scope="module")
def poses(recording):
    slam = Slam(Odometry(Rectifier(load_rig(recording / "short/mav0"))))
    return [slam.process(Received(payload, 0, 0)) for _, payload in read(recording, "short/stereo")]


def test_the_path_is_followed_within_one_percent(recording, poses):
    truth = positions(recording / "short/mav0", [pose["frame"] for pose in poses])
    length = np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    assert (length > 1, len(poses)) == (True, 50)
    assert trajectory_rmse(np.array([pose["position"] for pose in poses]), truth) < 0.01 * length


def test_every_frame_has_hundreds_of_inliers(poses):
    assert min(pose["inliers"] for pose in poses[1:]) > 200


def test_a_robot_that_stands_still_does_not_drift(poses):
    still = np.array([pose["position"] for pose in poses[:STILL_FRAMES]])
    assert np.abs(still).max() < 0.001


def test_a_black_picture_keeps_the_last_pose():
    odometry = Odometry(Rectifier(load_rig(euroc.RIG)))
    black = np.zeros((480, 752), np.uint8)
    poses = [odometry.track(black, black) for _ in range(2)]
    assert [pose.inliers for pose in poses] == [0, 0]
    assert poses[1].world_from_body == pytest.approx(np.eye(4), abs=1e-9)


@pytest.mark.parametrize(
    ("decision", "features"),
    [(UNPLANNED, 800), (Decision(2.0), 800), (Decision(0.5), 400), (Decision(0.01), 300)],
)
def test_the_work_follows_the_share(decision, features):
    odometry = Odometry(Rectifier(load_rig(euroc.RIG)))
    Slam(odometry).adapt(decision)
    assert odometry.features == features


@pytest.mark.parametrize("payload", [b"noise", encode(StereoFrame(1, b"", b"")), encode(StereoFrame(1, b"x", b"y"))])
def test_a_frame_that_cannot_be_read_is_refused(payload):
    with pytest.raises(MessageError):
        Slam(Odometry(Rectifier(load_rig(euroc.RIG)))).process(Received(payload, 0, 0))
