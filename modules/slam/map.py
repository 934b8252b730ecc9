"""The map: keyframes with their landmarks, connected by a pose graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.slam.geometry import angle, inverse, moved
from modules.slam.keyframes import make
from modules.slam.pose_graph import PoseGraph
from modules.slam.uncertainty import anywhere

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from modules.slam.features import View
    from modules.slam.geometry import Floats
    from modules.slam.keyframes import Keyframe
    from modules.slam.pose_graph import Edge
    from modules.slam.tracking import Fix

NEIGHBOURS = 12
"""Keyframes around one, by edges, that may see the same."""
METRES_PER_RADIAN = 3.0
"""How far a camera may move for its view to change as much as by a turn of one radian."""
WITH_PICTURE = 10
"""The newest keyframes, which keep their picture: landmarks of older ones are found by features."""
MOST_STRAIN = 100.0
"""What a true loop may add to the graph's strain; one that joins two places that only look alike adds thousands."""


class Map:
    """Everything that is remembered; at most `capacity` keyframes, the oldest is dropped first."""

    def __init__(self, capacity: int) -> None:
        self.keyframes: dict[int, Keyframe] = {}
        self.graph = PoseGraph()
        self._capacity = capacity
        self._next = self._segments = 0

    @property
    def landmarks(self) -> int:
        """How many landmarks are known."""
        return sum(map(len, self.keyframes.values()))

    @property
    def newest(self) -> Keyframe:
        """The keyframe that was added last."""
        return self.keyframes[self._next - 1]

    def beside(self, keyframe: Keyframe, world_from_camera: Floats, count: int) -> list[Keyframe]:
        """Keyframes connected with this one that look more like what a camera sees there than it does; best first."""
        near = [self.keyframes[number] for number in self.graph.near(keyframe.number, NEIGHBOURS)]

        def difference(other: Keyframe) -> float:
            change = inverse(other.world_from_camera) @ world_from_camera
            return moved(change) + METRES_PER_RADIAN * angle(change)

        alike = sorted(near, key=difference)
        return alike[: min(count, alike.index(keyframe))]

    def add(self, world_from_camera: Floats, view: View, points: Floats, fixes: Sequence[Fix]) -> Keyframe:
        """Remember a picture, connected with the keyframes that located it; without any it begins a new segment."""
        segment = fixes[0].keyframe.segment if fixes else self._segments
        self._segments += not fixes
        added = make(self._next, segment, world_from_camera, view, points)
        self.keyframes[added.number] = added
        self._next += 1
        if (older := self.keyframes.get(added.number - WITH_PICTURE)) is not None:
            older.image = None
        if fixes:
            added.covariance = fixes[0].covariance_in_map
        elif segment:  # nobody knows how far a lost camera went; the first picture is where the map begins
            added.covariance = anywhere()
        for fix in fixes:
            self.graph.add(fix.edge_to(added.number))
        return added

    def forget(self) -> int | None:
        """Forget the oldest keyframe if there are too many; returns its number. The origin stays where it was."""
        if len(self.keyframes) <= self._capacity:
            return None
        oldest = min(self.keyframes)
        self.graph.bypass(oldest)
        del self.keyframes[oldest]
        return oldest

    def close(self, loop: Edge) -> bool:
        """Move all keyframes to where a loop closes; nothing changes if that strains the graph more than drift does."""
        self._join(loop)
        before = self._poses()
        strain = self.graph.strain(before)
        self.graph.add(loop)
        after = self.graph.fitted(before, self._anchors())
        if self.graph.strain(after) > strain + MOST_STRAIN:
            self.graph.remove(loop)
            return False
        for number, pose in after.items():
            self.keyframes[number].world_from_camera = pose
        self._reassess()
        return True

    def _join(self, loop: Edge) -> None:
        """If the loop connects two segments, carry the later one to where it belongs beside the other."""
        first, second = (self.keyframes[number].segment for number in (loop.first, loop.second))
        if first == second:
            return
        poses = self._poses()
        correction = poses[loop.first] @ loop.first_from_second @ inverse(poses[loop.second])
        if first > second:
            correction = inverse(correction)
        for kept in self.keyframes.values():
            if kept.segment == max(first, second):
                kept.segment = min(first, second)
                kept.world_from_camera = correction @ kept.world_from_camera

    def _reassess(self) -> None:
        """Covariances after a loop: keyframes near it are as sure as where it leads to."""
        known = {number: self.keyframes[number].covariance for number in self._anchors()}
        for number, covariance in self.graph.uncertainties(known).items():
            self.keyframes[number].covariance = covariance

    def _anchors(self) -> list[int]:
        """The first keyframe of each segment."""
        firsts: dict[int, int] = {}
        for number, kept in self.keyframes.items():
            firsts.setdefault(kept.segment, number)
        return list(firsts.values())

    def _poses(self) -> Mapping[int, Floats]:
        return {number: kept.world_from_camera for number, kept in self.keyframes.items()}
