"""Where pictures come from: a recorded sequence, or V4L2 devices."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol, TypeAlias

import cv2

from robotkit import ConfigurationError, DeviceError, euroc
from robotkit.playback import Playback
from robotkit.stereo import StereoFrame, encode

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Sequence
    from pathlib import Path

Frames: TypeAlias = "Iterator[tuple[int, bytes]]"

VIEWS = ("stereo", "cam0", "cam1")
JPEG_QUALITY = 90
OLDEST_NS = 60 * 10**9
"""What is older by a device's clock is of another clock."""


class Source(Protocol):
    """Gives frames with their stamps (ns since 1970) until the end."""

    def frames(self, ended: threading.Event) -> Frames:
        """Open the source, yield (stamp, frame), and release the source when closed."""


class Recorded:
    """A EuRoC sequence at its own pace, as the files hold it; `view` is `stereo`, or one camera's name."""

    def __init__(self, folder: Path, view: str) -> None:
        self._mav0 = euroc.find(folder)
        for camera in ("cam0", "cam1") if view == "stereo" else (view,):
            if not (self._mav0 / camera / "data.csv").is_file():
                raise euroc.DatasetError(f"{self._mav0 / camera / 'data.csv'}: missing, and needed for view {view}")
        self._view = view
        self._playback = Playback()

    def frames(self, ended: threading.Event) -> Frames:
        """Continue from where the recording would be by now."""
        if self._view == "stereo":
            return self._stereo(ended)
        return self._playback.play(euroc.pictures(self._mav0, self._view), ended)

    def _stereo(self, ended: threading.Event) -> Frames:
        recorded = ((frame.stamp, frame) for frame in euroc.stereo(self._mav0))
        for due, frame in self._playback.play(recorded, ended):
            yield due, encode(frame)  # the recording's own stamp is inside, for comparison with ground truth


class Devices:
    """One V4L2 device as JPEG, or two as a stereo frame: both grab first, so that they look at the same instant."""

    def __init__(self, paths: Sequence[str], capture: type[cv2.VideoCapture] = cv2.VideoCapture) -> None:
        if len(paths) not in (1, 2):
            raise ConfigurationError(
                f"CAMERA_SOURCE: invalid value {','.join(paths)!r}: expected one device, or left and right"
            )
        self._paths = paths
        self._capture = capture

    def frames(self, ended: threading.Event) -> Frames:
        """Yield pictures until the end; DeviceError when a device can't be opened or gives nothing more."""
        captures = [self._capture(path, cv2.CAP_V4L2) for path in self._paths]
        try:
            for path, capture in zip(self._paths, captures, strict=True):
                if not capture.isOpened():
                    raise DeviceError(f"camera {path} can't be opened")
            while not ended.is_set():
                yield self._look(captures)
        finally:
            for capture in captures:
                capture.release()

    def _look(self, captures: Sequence[cv2.VideoCapture]) -> tuple[int, bytes]:
        before = time.time_ns()
        grabbed = [capture.grab() for capture in captures]
        device = captures[0].get(cv2.CAP_PROP_POS_MSEC)
        stamp = _taken(device, time.monotonic_ns(), now=time.time_ns(), otherwise=before)
        pictures = [capture.retrieve() for capture in captures]
        for path, caught, (retrieved, _) in zip(self._paths, grabbed, pictures, strict=True):
            if not caught or not retrieved:
                raise DeviceError(f"camera {path} delivers no pictures")
        encoded = [
            cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
            for _, picture in pictures
        ]
        return stamp, encode(StereoFrame(stamp, *encoded)) if len(encoded) == 2 else encoded[0]


def _taken(device: float, monotonic: int, *, now: int, otherwise: int) -> int:
    """When the device took a picture, by its own stamp: ms of the clock `monotonic`; `otherwise` if it has none.

    Up to four pictures wait in its buffers, so one that is grabbed now can be as old as four of our turns.
    """
    age = monotonic - round(device * 1e6)
    return now - age if device > 0 and 0 <= age < OLDEST_NS else otherwise
