from __future__ import annotations

import threading
from typing import cast

import cv2
import numpy as np
import pytest

from modules.camera.sources import Devices, Recorded
from modules.camera.task import Camera
from robotkit import ConfigurationError, DeviceError
from robotkit.euroc import DatasetError
from robotkit.stereo import decode

START = 1403636579763555584
MS = 10**6


@pytest.fixture
def sequence(tmp_path):
    """Three frames of 1 ms in the real layout."""
    for camera in ("cam0", "cam1"):
        folder = tmp_path / "MH_01_easy/mav0" / camera
        (folder / "data").mkdir(parents=True)
        stamps = [START + step * MS for step in range(3)]
        (folder / "data.csv").write_text("".join(f"{stamp},{stamp}.png\r\n" for stamp in stamps))
        for stamp in stamps:
            (folder / "data" / f"{stamp}.png").write_bytes(f"{camera} {stamp - START}".encode())
    return tmp_path / "MH_01_easy"


class Film(Recorded):
    """Frames of any stamps."""

    def __init__(self, stamps):
        self._stamps = stamps

    def frames(self, _ended):
        yield from ((stamp, b"frame") for stamp in self._stamps)


class Clock:
    """A clock that stands still unless the test moves it: ns since 1970, and since the start of the machine."""

    def __init__(self):
        self.since_start = 3600 * 10**9

    def time_ns(self):
        return START + self.since_start

    def monotonic_ns(self):
        return self.since_start


class Capture:
    """A camera with three pictures."""

    def __init__(self, path, backend):
        assert backend == cv2.CAP_V4L2
        self.path, self.left, self.released = path, 3, False
        CAPTURES.append(self)

    def isOpened(self):  # noqa: N802 - OpenCV's name
        return "missing" not in self.path

    def grab(self):
        self.left -= 1
        return self.left >= 0

    def get(self, _):
        return -1.0  # OpenCV's word for a property that a camera lacks

    def retrieve(self):
        return self.left >= 0, np.full((48, 64, 3), 10 * max(self.left, 0), np.uint8)

    def release(self):
        self.released = True


CAPTURES: list[Capture] = []
CAPTURE = cast("type[cv2.VideoCapture]", Capture)  # it can't inherit: what OpenCV frees was never made


def payload(result):
    assert isinstance(result.value, bytes)
    return result.value


def test_a_recorded_pair_keeps_the_recordings_stamp_inside(sequence):
    results = list(Camera(Recorded(sequence, "stereo"), output="stereo").produce(threading.Event()))
    frames = [decode(payload(result)) for result in results]
    assert [frame.stamp for frame in frames] == [START, START + MS, START + 2 * MS]
    assert (frames[0].left, frames[0].right) == (b"cam0 0", b"cam1 0")
    assert np.diff([result.stamp for result in results]).tolist() == [MS, MS]
    assert results[0].stamp is not None
    assert results[0].stamp > START  # now, not the day of the recording


def test_one_camera_of_a_sequence(sequence):
    results = list(Camera(Recorded(sequence, "cam1"), output="picture").produce(threading.Event()))
    assert [result.value for result in results] == [b"cam1 0", b"cam1 1000000", b"cam1 2000000"]
    assert {result.output for result in results} == {"picture"}


def test_a_sequence_without_the_camera_is_refused(sequence):
    (sequence / "mav0/cam1/data.csv").unlink()
    with pytest.raises(DatasetError, match=r"cam1/data\.csv: missing, and needed for view stereo"):
        Recorded(sequence, "stereo")


@pytest.mark.parametrize(("rate", "kept"), [(None, 20), (10, 10), (5, 5), (1000, 20)])
def test_the_rate_is_kept_on_average(rate, kept):
    stamps = [START + step * 50 * MS + (step % 3) * MS for step in range(20)]  # 20 Hz that trembles
    assert len(list(Camera(Film(stamps), output="picture", rate=rate).produce(threading.Event()))) == kept


def test_two_devices_give_pairs_until_one_is_unplugged():
    CAPTURES.clear()
    frames = Camera(Devices(["/dev/video0", "/dev/video2"], CAPTURE), output="stereo").produce(threading.Event())
    pair = decode(payload(next(frames)))
    left = cv2.imdecode(np.frombuffer(pair.left, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert left is not None
    assert left.shape == (48, 64)
    with pytest.raises(DeviceError, match="camera /dev/video0 delivers no pictures"):
        list(frames)
    assert [capture.released for capture in CAPTURES] == [True, True]


@pytest.mark.parametrize(
    ("age", "stamped"),
    [
        (120 * MS, -120 * MS),  # it waited in the driver's buffers
        (40 * MS, -40 * MS),
        (None, -33 * MS),  # no stamp of its own: at the latest when we began to wait for it
        (-5 * MS, -33 * MS),
        (3600 * 10**9 - 1, -33 * MS),  # of another clock
    ],
)
def test_a_pictures_stamp_is_that_of_its_device(monkeypatch, age, stamped):
    clock = Clock()
    monkeypatch.setattr("modules.camera.sources.time", clock)

    class Stamping(Capture):
        def grab(self):
            clock.since_start += 33 * MS
            return super().grab()

        def get(self, _):
            return 0.0 if age is None else (clock.since_start - age) / MS

    devices = Devices(["/dev/video0"], cast("type[cv2.VideoCapture]", Stamping))
    stamp, _ = next(devices.frames(threading.Event()))
    assert stamp - clock.time_ns() == stamped


def test_a_suspended_camera_lets_go_of_its_device():
    CAPTURES.clear()
    frames = Camera(Devices(["/dev/video0"], CAPTURE), output="picture").produce(threading.Event())
    assert payload(next(frames)).startswith(b"\xff\xd8")
    frames.close()
    assert CAPTURES[0].released


def test_a_device_that_is_missing_is_named():
    with pytest.raises(DeviceError, match="camera /dev/missing can't be opened"):
        list(Devices(["/dev/missing"], CAPTURE).frames(threading.Event()))


def test_three_devices_are_too_many():
    with pytest.raises(ConfigurationError, match="one device, or left and right"):
        Devices(["/dev/video0"] * 3)
