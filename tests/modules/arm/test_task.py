from __future__ import annotations

import json
import queue
import threading
import time
from collections import defaultdict
from contextlib import contextmanager
from itertools import cycle, pairwise
from typing import Any
from unittest.mock import MagicMock

import pytest

from modules.arm import controller, task
from modules.arm.joints import NAMES
from modules.arm.motion import STEP_S
from modules.arm.simulator import Maestro
from modules.arm.task import MeArm
from robotkit import Decision, DeviceError, Received
from robotkit.simulated import on_a_pseudo_terminal
from tests.modules.arm.test_joints import ARM
from tests.waiting import PATIENCE

AWAY, BACK = {"move": [68, 100, 60], "grip": "open"}, {"home": True}


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """With a device that shares a busy machine with its task."""
    monkeypatch.setattr(controller, "ANSWER_S", PATIENCE)


class Witness(Maestro):
    """Remembers which targets it was sent, by channel."""

    def __init__(self):
        super().__init__()
        self.sent = defaultdict(list)

    def _aim(self, channel, target):
        super()._aim(channel, target)
        self.sent[channel].append(target)


class World:
    """The arm at work on a simulated Maestro, and what it publishes."""

    def __init__(self, device, arm):
        self.device = device
        self.arm = arm
        self.results: queue.Queue[Any] = queue.Queue()
        self.ended = threading.Event()

    def work(self):
        try:
            for result in self.arm.produce(self.ended):
                self.results.put(result.value)
        except DeviceError as error:
            self.results.put(error)

    def order(self, order):
        now = time.time_ns()
        self.arm.process(Received(json.dumps(order).encode(), now, now, "order"))

    def next(self, doing):
        deadline = time.monotonic() + PATIENCE
        while True:
            state = self.results.get(timeout=max(deadline - time.monotonic(), 0.01))
            if isinstance(state, DeviceError) or state["doing"] == doing:
                return state


@contextmanager
def an_arm(device=None):
    device = device or Maestro()
    with on_a_pseudo_terminal(device) as port:
        world = World(device, MeArm(ARM, port))
        thread = threading.Thread(target=world.work)
        thread.start()
        try:
            yield world
        finally:
            world.ended.set()
            world.arm.close()
            thread.join(PATIENCE)
    assert not thread.is_alive()


def test_it_moves_to_a_point_and_publishes_where_it_is():
    with an_arm() as world:
        world.next("resting")
        world.order(AWAY)
        state = world.next("arrived")
    assert state["position"] == pytest.approx([68, 100, 60], abs=0.1)
    assert (state["joints"]["grip"], state["errors"]) == (90, 0)
    for name in NAMES:
        joint = ARM.joints[name]
        target = joint.angle_at(world.device.targets[joint.channel] / 4)
        assert target == pytest.approx(state["joints"][name], abs=0.2)


@pytest.mark.parametrize(
    "stop",
    [
        lambda world: world.order({"stop": True}),
        lambda world: world.arm.adapt(Decision(share=0.01, weight=0, suspended=True)),
        lambda world: world.arm.close(),
        lambda world: world.ended.set(),
    ],
    ids=["stop order", "suspended", "closed", "ended"],
)
def test_stopping_leaves_no_target_beyond_one_step(stop):
    with an_arm(Witness()) as world:
        world.next("resting")
        world.order(AWAY)
        world.next("moving")
        stop(world)
        with world.arm._lock:  # whatever step was under way is done
            assert world.arm._goal is None or world.ended.is_set()
    for name in NAMES:
        joint = ARM.joints[name]
        angles = [joint.angle_at(target / 4) for target in world.device.sent[joint.channel]]
        assert angles[-1] == pytest.approx(world.arm._posture[name], abs=0.5), "nothing was sent ahead"
        assert max(abs(after - before) for before, after in pairwise(angles)) <= joint.speed * STEP_S + 0.5


def test_relaxed_it_sends_no_pulses():
    with an_arm() as world:
        world.next("resting")
        world.order(AWAY)
        world.next("moving")
        world.order({"relax": True})
        world.next("relaxed")
        assert world.device.targets[:4] == [0, 0, 0, 0]


def test_an_arm_that_was_left_somewhere_moves_on_from_there():
    device = Maestro()
    posture = ARM.posture_at((120, -60, 50), grip=45)
    for name in NAMES:
        joint = ARM.joints[name]
        device.targets[joint.channel] = round(joint.pulse_at(posture[name]) * 4)
        device.pulses[joint.channel] = float(device.targets[joint.channel])
    with an_arm(device) as world:
        assert world.next("resting")["position"] == pytest.approx([120, -60, 50], abs=0.5)


def test_a_silent_device_is_reported(monkeypatch):
    monkeypatch.setattr(controller, "ANSWER_S", 0.1)
    device = Maestro()
    monkeypatch.setattr(device, "receive", lambda _: b"")
    with an_arm(device) as world:
        assert "no answer to a1 " in str(world.results.get(timeout=PATIENCE))


def test_an_arm_that_is_unplugged_while_it_rests_is_reported(monkeypatch):
    with an_arm() as world:
        world.next("resting")
        monkeypatch.setattr(controller, "ANSWER_S", 0.1)
        world.device.receive = lambda _: b""
        assert "expected a Maestro" in str(world.next("never"))


def test_a_connection_that_takes_longer_than_a_suspension_leaves_the_next_one_its_arm(monkeypatch):
    arm, ended = MeArm(ARM, "/dev/arm"), threading.Event()
    resumed = arm.produce(threading.Event())
    line = MagicMock(read=MagicMock(side_effect=cycle([b"", bytes(2)])))
    line.__enter__.return_value = line

    def connect(_port, _baud):
        if not ended.is_set():
            ended.set()
            next(resumed)
        return line

    monkeypatch.setattr(task, "open_line", connect)
    assert list(arm.produce(ended)) == []
    World(None, arm).order(BACK)
    assert arm._goal is not None
    resumed.close()
    assert arm._controller is None


def test_an_order_without_an_arm_is_a_device_error():
    with pytest.raises(DeviceError, match="no arm is connected"):
        World(None, MeArm(ARM, "/dev/nowhere")).order(BACK)
