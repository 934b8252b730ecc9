from __future__ import annotations

import math
import queue
import threading
from contextlib import contextmanager
from typing import Any

import pytest

from modules.lidar import rplidar, scanner
from modules.lidar.rplidar import PROTECTING, Health
from modules.lidar.simulator import ROOM, RplidarA1, seen
from modules.lidar.task import Lidar, build
from robotkit import ConfigurationError, DeviceError
from robotkit.simulated import on_a_pseudo_terminal
from tests.waiting import PATIENCE


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """With a device that shares a busy machine with its task."""
    monkeypatch.setattr(scanner, "ANSWER_S", PATIENCE)
    monkeypatch.setattr(scanner, "SPIN_UP_S", PATIENCE)


class Witness(RplidarA1):
    """A lidar that can be noisy or broken, and reports when its scan ends."""

    def __init__(self):
        super().__init__(lambda angle: seen(ROOM, 0, 0, -math.radians(angle)))
        self.noise = b""
        self.lasting = False
        self.idle = threading.Event()

    def receive(self, data):
        ill = self.health
        answer = super().receive(data)
        if self.lasting:
            self.health = ill
        if self.scanning is None:
            self.idle.set()
        else:
            self.idle.clear()
        return answer

    def advance(self, seconds):
        return super().advance(seconds) + self.noise


@contextmanager
def scans(device, **settings):
    """Let the task work on the device, and give its results."""
    results: queue.Queue[Any] = queue.Queue()
    ended = threading.Event()

    def work(port):
        try:
            for result in Lidar(port, **settings).produce(ended):
                results.put(result.value)
        except DeviceError as error:
            results.put(error)

    with on_a_pseudo_terminal(device) as port:
        thread = threading.Thread(target=work, args=(port,))
        thread.start()
        try:
            yield results
        finally:
            ended.set()
            thread.join(PATIENCE)
    assert not thread.is_alive()


@pytest.mark.parametrize("mode", scanner.MODES)
def test_a_scan_shows_the_room(mode):
    with scans(Witness(), mode=mode) as results:
        scan = results.get(timeout=PATIENCE)
    assert len(scan["ranges"]) == 360
    assert [scan["ranges"][at] for at in (0, 90, 180, 270)] == pytest.approx([3, 1.5, 2, 1.5], rel=0.02)
    assert scan["nearest"] == pytest.approx(1.5, rel=0.02)
    assert scan["end_angle"] == pytest.approx(math.tau * 359 / 360)
    assert scan["skipped"] == 0


def test_a_lidar_that_is_mounted_backward_shows_the_same_room():
    device = Witness()
    device._distance = lambda angle: seen(ROOM, 0, 0, -math.radians(angle + 180))
    with scans(device, forward=180.0) as results:
        assert results.get(timeout=PATIENCE)["ranges"][0] == pytest.approx(3, rel=0.02)


@pytest.mark.parametrize("mode", scanner.MODES)
def test_noise_on_the_line_is_counted_and_the_scans_continue(mode, monkeypatch):
    monkeypatch.setattr(scanner, "ANSWER_S", 1.0)  # before it begins it waits that long for the noise to end
    device = Witness()
    device.noise = b"\x13\xa5"
    with scans(device, mode=mode) as results:
        scans_ = [results.get(timeout=PATIENCE) for _ in range(3)]
    assert scans_[-1]["skipped"] > 0
    assert min(filter(None, scans_[-1]["ranges"])) > 1


def test_the_laser_is_off_when_the_task_ends():
    device = Witness()
    with scans(device) as results:
        results.get(timeout=PATIENCE)
        assert not device.idle.is_set()
    assert device.idle.wait(PATIENCE)


def test_a_lidar_that_protects_itself_is_reset():
    device = Witness()
    device.health = Health(PROTECTING, 1)
    with scans(device) as results:
        assert results.get(timeout=PATIENCE)["samples"] > 300


def test_a_lidar_that_fails_again_after_a_reset_is_reported():
    device = Witness()
    device.health, device.lasting = Health(PROTECTING, 0x8001), True
    with scans(device) as results:
        assert "has shut itself down, error code 0x8001" in str(results.get(timeout=PATIENCE))


def test_a_lidar_that_falls_silent_is_reported(monkeypatch):
    device = Witness()
    with scans(device) as results:
        results.get(timeout=PATIENCE)
        monkeypatch.setattr(scanner, "ANSWER_S", 0.2)
        for _ in range(5):  # what was read before has at most three turns: the new patience holds
            results.get(timeout=PATIENCE)
        device.receive(rplidar.STOP)
        reported = results.get(timeout=PATIENCE)
        while not isinstance(reported, DeviceError):
            reported = results.get(timeout=PATIENCE)
    assert "no samples for 0.2 s" in str(reported)


def test_a_silent_device_is_reported(monkeypatch):
    monkeypatch.setattr(scanner, "ANSWER_S", 0.1)
    device = Witness()
    monkeypatch.setattr(device, "receive", lambda _: b"")
    with scans(device) as results:
        assert "no answer to a5 52 within 0.1 s" in str(results.get(timeout=PATIENCE))


def test_all_mistakes_in_the_environment_are_reported_at_once():
    with pytest.raises(ConfigurationError) as caught:
        build({"LIDAR_MODE": "fast", "LIDAR_FORWARD": "nan"})
    assert str(caught.value) == (
        "LIDAR_MODE: invalid value 'fast': expected standard or express\n"
        "LIDAR_FORWARD: invalid value 'nan': expected an angle in degrees"
    )
