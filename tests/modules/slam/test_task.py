"""The module's task: what a message makes of a picture, what quality makes of the work, and what bad data does."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from modules.slam.slam import Effort, Pose, State, StereoSlam
from modules.slam.task import Slam
from robotkit import MessageError, Received
from robotkit.stereo import StereoFrame, encode
from tests.modules.slam.recording import BLACK, slam
from timelines.datasets.readers import read

SENT = 1_795_300_000_000_000_000
BLACK_PNG = cv2.imencode(".png", BLACK)[1].tobytes()


@pytest.mark.parametrize(
    ("quality", "features", "overlap"),
    [
        (1.0, 800, 0.75),
        (0.5, 625, 0.475),
        (0.1, 485, 0.255),
    ],
)
def test_the_work_follows_the_quality(quality, features, overlap):
    module = slam()
    Slam(module).set_quality(quality)
    assert module.effort.features == features
    assert module.effort.overlap == pytest.approx(overlap)


def pictures(short):
    payloads = [payload for _, payload in read(short.parent, "short/stereo")]
    assert all(isinstance(payload, bytes) for payload in payloads)
    return payloads


def test_a_pose_is_plain_json(short):
    task = Slam(slam())
    messages = [result.value for payload in pictures(short)[:2] for result in task.process(Received(payload, 0, 0))]
    message = json.loads(json.dumps(messages[1]))
    assert message["frame"] > 1e18
    assert message["position"] == pytest.approx([0, 0, 0], abs=0.001)
    assert message["orientation"] == pytest.approx([0, 0, 0, 1], abs=0.001)
    assert message["inliers"] > 200
    assert (message["state"], message["keyframes"], message["loops"]) == ("tracking", 1, 0)
    assert message["landmarks"] > 300


PICTURE = cv2.imencode(".png", np.zeros((240, 320), np.uint8))[1].tobytes()


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"noise",
        encode(StereoFrame(1, b"", b"")),
        encode(StereoFrame(1, b"x", b"y")),
        encode(StereoFrame(1, PICTURE, PICTURE)),
        encode(StereoFrame(1, BLACK_PNG, BLACK_PNG))[:-10],
        encode(StereoFrame(1, BLACK_PNG[:60], BLACK_PNG)),
        encode(StereoFrame(1, BLACK_PNG, b"cut off")),
    ],
)
def test_a_frame_that_cannot_be_read_is_refused(payload):
    with pytest.raises(MessageError):
        Slam(slam()).process(Received(payload, 0, 0))


def test_a_bad_frame_changes_nothing(short):
    undisturbed, disturbed = Slam(slam()), Slam(slam())
    for payload in pictures(short)[:12:3]:
        with pytest.raises(MessageError):
            disturbed.process(Received(encode(StereoFrame(1, PICTURE, b"")), 0, 0))
        assert disturbed.process(Received(payload, 0, 0)) == undisturbed.process(Received(payload, 0, 0))


class Idle(StereoSlam):
    """SLAM that only counts how often it may look for loops."""

    size = (752, 480)
    effort = Effort()

    def __init__(self):
        self.searches = 0
        self.keyframe = False
        self.map: Any = SimpleNamespace(keyframes={}, landmarks=0)
        self.loops: Any = SimpleNamespace(closed=0)

    def track(self, _left, _right):
        return Pose(np.eye(4), 100, State.TRACKING, self.keyframe)

    def close_loop(self):
        self.searches += 1


@pytest.mark.parametrize(("taken", "stamp"), [(SENT - 40_000_000, SENT - 40_000_000), (SENT - 10**17, SENT)])
def test_a_pose_has_the_stamp_of_its_picture_unless_a_recording_is_played(taken, stamp):
    frame = encode(StereoFrame(taken, BLACK_PNG, BLACK_PNG))
    (result,) = Slam(Idle()).process(Received(frame, SENT, SENT + 1_000_000))
    assert isinstance(result.value, dict)
    assert (result.output, result.stamp, result.value["frame"]) == ("pose", stamp, taken)


def test_loops_are_looked_for_only_when_no_picture_waits():
    clock = iter([150, 350, 450])
    idle = Idle()
    task = Slam(idle, now=lambda: next(clock))
    frame = encode(StereoFrame(1, BLACK_PNG, BLACK_PNG))
    counts = []
    for received in (100, 120, 400):  # the second one came while the first was in work
        task.process(Received(frame, received, received))
        counts.append(idle.searches)
    assert counts == [1, 1, 2]


def test_no_loop_search_after_a_new_keyframe():
    idle = Idle()
    idle.keyframe = True
    Slam(idle, now=lambda: 0).process(Received(encode(StereoFrame(1, BLACK_PNG, BLACK_PNG)), 1, 1))
    assert idle.searches == 0
