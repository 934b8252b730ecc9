"""Follows signs from picture to picture: each is reported once, as read best, and again when it left and came back.

Pure: the stamps of pictures are the time.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from modules.signs.reading import Array, Reading

NUMBER = re.compile(r"[A-Za-z]{0,2}[-./]?\d{1,5}([-./]\d{1,4})?[A-Za-z]?")
"""Room and house numbers: 214, B12, 3.07, 17a, 12-14."""
SURE = 0.9
"""Confidence from which on a text counts as read."""
FAIR = 0.6
"""What a sign that has left needs, if it was never read surely."""
AGREEING = 2
"""Pictures in which the same text must be read: a blurred one alone may be wrong."""
LOST_NS = 2_000_000_000
"""A sign that was not seen for so long, and in two pictures, has left."""
_MISSES = 2
_NEAR, _SAME = 0.1, 0.5
"""Overlap with a sign's last place from which on a text may be that sign; and from which on it surely is."""
_ATTEMPTS = 4
"""A text that was no number so often is not read again before it is larger by a third."""
_LARGER = 1.33


@dataclass(frozen=True)
class Sign:
    """What is reported: the text as it was read best, where and when that was, and in how many pictures it was seen."""

    text: str
    confidence: float
    corners: Array
    stamp: int
    pictures: int


@dataclass
class _Vote:
    """A text that was read, how often, and its best reading."""

    count: int = 0
    confidence: float = 0
    corners: Array = field(default_factory=lambda: np.zeros((4, 2), np.float32))
    stamp: int = 0


@dataclass
class Track:
    """A sign, or a text that is none, since it was seen first."""

    corners: Array
    seen: int
    pictures: int = 0
    missed: int = 0
    reported: str | None = None
    attempts: int = 0
    height: float = 0
    votes: dict[str, _Vote] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """What it says, as far as is known: what was read most often, then most surely."""
        rank = {text: (vote.count, vote.confidence) for text, vote in self.votes.items()}
        return max(rank, key=rank.__getitem__, default="")

    def known(self, stamp: int) -> str:
        """What a text at its place must not contradict, empty when nothing: what was reported, or read long before.

        Pictures that follow each other may be of a sign that is still read wrongly; a task that got no CPU for seconds
        sees the next sign where the last one was.
        """
        if self.reported is not None:
            return self.reported
        return self.text if stamp - self.seen > LOST_NS else ""

    def sign(self) -> Sign:
        """The sign as it is reported."""
        vote = self.votes[self.text]
        return Sign(self.text, vote.confidence, vote.corners, vote.stamp, self.pictures)

    def is_sure(self) -> bool:
        """Whether two pictures agree, one of them clearly."""
        vote = self.votes.get(self.text)
        return vote is not None and vote.count >= AGREEING and vote.confidence >= SURE

    def is_settled(self, corners: Array) -> bool:
        """Whether reading the text there would add nothing new."""
        if self.reported is not None:
            return True
        return not self.votes and self.attempts >= _ATTEMPTS and _height(corners) < self.height * _LARGER


class Tracker:
    """All signs that are in sight."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []

    @property
    def is_settled(self) -> bool:
        """Whether a picture that shows the same again has nothing to add."""
        return all(track.is_settled(track.corners) for track in self._tracks)

    def linger(self, stamp: int) -> None:
        """Take note of a picture that shows what the last one did."""
        for track in self._tracks:
            if not track.missed:
                track.seen, track.pictures = stamp, track.pictures + 1

    def follow(self, texts: Sequence[Array], stamp: int, read: Callable[[Array], Reading]) -> list[Sign]:
        """Take the texts of a picture; `read` is asked only for those that are not known. Returns what is new."""
        for track in self._tracks:
            track.missed += 1
        for corners, known in self._paired(texts):
            self._see(known, corners, stamp, read)
        return [*self._read_now(), *self._gone(stamp)]

    def _paired(self, texts: Sequence[Array]) -> list[tuple[Array, Track | None]]:
        """Each text with the track that was nearest to its place; no track twice."""
        overlaps = [
            (_overlap(track.corners, corners), index, track)
            for index, corners in enumerate(texts)
            for track in self._tracks
        ]
        pairs: dict[int, Track] = {}
        for overlap, index, track in sorted(overlaps, key=lambda one: -one[0]):
            if overlap >= _NEAR and index not in pairs and all(track is not other for other in pairs.values()):
                pairs[index] = track
        return [(corners, pairs.get(index)) for index, corners in enumerate(texts)]

    def _see(self, track: Track | None, corners: Array, stamp: int, read: Callable[[Array], Reading]) -> None:
        if track is not None and track.is_settled(corners) and self._is_unmoved(track, corners, stamp):
            _place(track, corners, stamp)
            return
        reading = read(corners)
        number = reading.text if NUMBER.fullmatch(reading.text) else ""
        track = self._of(number, reading.confidence, track, stamp) or self._begin()
        _place(track, corners, stamp)
        track.attempts += 1
        track.height = _height(corners)
        if number:
            vote = track.votes.setdefault(number, _Vote())
            vote.count += 1
            if reading.confidence > vote.confidence:
                vote.confidence, vote.corners, vote.stamp = reading.confidence, corners, stamp

    def _is_unmoved(self, track: Track, corners: Array, stamp: int) -> bool:
        return _overlap(track.corners, corners) >= _SAME and stamp - track.seen <= LOST_NS

    def _of(self, number: str, confidence: float, near: Track | None, stamp: int) -> Track | None:
        """The track that a text belongs to: the one near it unless it is another sign, or one that has jumped."""
        if near is not None and (near.known(stamp) in {"", number} or not number or confidence < SURE):
            return near
        jumped = (
            track for track in self._tracks if track.missed and track is not near and number and track.text == number
        )
        return next(jumped, None)

    def _begin(self) -> Track:
        track = Track(np.zeros((4, 2), np.float32), 0)
        self._tracks.append(track)
        return track

    def _read_now(self) -> list[Sign]:
        new = [track for track in self._tracks if track.reported is None and track.is_sure()]
        for track in new:
            track.reported = track.text
        return [track.sign() for track in new]

    def _gone(self, stamp: int) -> list[Sign]:
        gone = [track for track in self._tracks if track.missed >= _MISSES and stamp - track.seen > LOST_NS]
        self._tracks = [track for track in self._tracks if all(track is not other for other in gone)]
        unreported = (track.sign() for track in gone if track.reported is None and track.votes)
        return [sign for sign in unreported if sign.confidence >= FAIR]


def _place(track: Track, corners: Array, stamp: int) -> None:
    track.corners, track.seen, track.missed = corners, stamp, 0
    track.pictures += 1


def _height(corners: Array) -> float:
    return float(np.linalg.norm(corners[3] - corners[0]) + np.linalg.norm(corners[2] - corners[1])) / 2


def _overlap(first: Array, second: Array) -> float:
    """Intersection over union of the upright boxes around two texts."""
    left, top, width, height = cv2.boundingRect(first)
    other = cv2.boundingRect(second)
    across = min(left + width, other[0] + other[2]) - max(left, other[0])
    down = min(top + height, other[1] + other[3]) - max(top, other[1])
    shared = max(across, 0) * max(down, 0)
    return shared / (width * height + other[2] * other[3] - shared)
