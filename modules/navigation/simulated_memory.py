"""What a simulated Create 2 remembers: how far it went since it last said so, what it was asked for, and its songs.

Source: the Open Interface specification, packets 19, 20 and 36 to 42, commands SONG and PLAY.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from modules.navigation import packets
from modules.navigation.odometry import WHEEL_BASE

TICK = 1 / 64
"""Seconds, the unit of a note's duration."""
_LIMIT = 0x7FFF


@dataclass
class Journey:
    """Distance and angle by the wheels, each since it was last sent; what no packet could hold is capped."""

    distance: float = 0.0
    angle: float = 0.0
    """mm and degrees, counter-clockwise."""

    def roll(self, left: float, right: float) -> None:
        """Add what the wheels turned, in metres."""
        self.distance += (left + right) * 500
        self.angle += math.degrees((right - left) / WHEEL_BASE)

    def values(self) -> packets.Values:
        """Whole mm and degrees."""
        return {packets.DISTANCE: _capped(self.distance), packets.ANGLE: _capped(self.angle)}

    def reset(self, members: tuple[int, ...]) -> None:
        """Restart from what was sent; the fractions that were not stay."""
        if packets.DISTANCE in members:
            self.distance -= int(self.distance)
        if packets.ANGLE in members:
            self.angle -= int(self.angle)


@dataclass
class Jukebox:
    """Songs by number, each a list of durations, and the one that plays."""

    songs: dict[int, float] = field(default_factory=dict)
    """Seconds that each takes."""
    number: int = 0
    left: float = 0.0
    """Seconds until the song that plays has ended."""

    def write(self, number: int, notes: tuple[int, ...]) -> None:
        """Take a song: pairs of a note and its duration in 1/64 s."""
        self.songs[number] = sum(notes[1::2]) * TICK

    def play(self, number: int) -> None:
        """Play a song that is known, unless one is playing: then the command is ignored."""
        if self.left <= 0 and number in self.songs:
            self.number, self.left = number, self.songs[number]

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.left = max(self.left - seconds, 0.0)

    def values(self) -> packets.Values:
        """The song selected last, and whether it plays."""
        return {packets.SONG_NUMBER: self.number, packets.SONG_PLAYING: int(self.left > 0)}


def _capped(value: float) -> int:
    return min(max(int(value), -_LIMIT - 1), _LIMIT)
