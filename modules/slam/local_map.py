"""The map: keyframes with their landmarks, connected by a pose graph; and the part of it that is around."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import apply, inverse
from modules.slam.keyframes import Keyframe
from modules.slam.pose_graph import Edge, PoseGraph
from modules.slam.tracking import Landmarks

if TYPE_CHECKING:
    from collections.abc import Mapping

    from modules.slam.features import Features
    from modules.slam.geometry import Floats
    from modules.slam.tracking import Fix

LOCAL_KEYFRAMES = 8
"""How many keyframes around the reference are looked at."""
MOST_STRAIN = 100.0
"""What a true loop may add to the graph's strain; one that joins two places that only look alike adds thousands."""
MIN_SHARED = 20
"""Landmarks of a keyframe that a new one must see to be connected with it."""


class Map:
    """Everything that is remembered; at most `capacity` keyframes, of which the oldest is forgotten first."""

    def __init__(self, capacity: int) -> None:
        self.keyframes: dict[int, Keyframe] = {}
        self.graph = PoseGraph()
        self._capacity = capacity
        self._next = self._segments = 0

    @property
    def landmarks(self) -> int:
        """How many landmarks are known."""
        return sum(int(keyframe.owned.sum()) for keyframe in self.keyframes.values())

    def around(self, number: int) -> Landmarks:
        """Landmarks of a keyframe and of those near it in the graph."""
        near = [self.keyframes[other] for other in self.graph.near(number, LOCAL_KEYFRAMES)]
        rows = [keyframe.landmarks for keyframe in near]
        places = [
            apply(keyframe.world_from_camera, keyframe.points[own]) for keyframe, own in zip(near, rows, strict=True)
        ]
        return Landmarks(
            np.vstack(places),
            np.vstack([keyframe.descriptors(own) for keyframe, own in zip(near, rows, strict=True)]),
            np.repeat([keyframe.number for keyframe in near], [len(own) for own in rows]),
            np.concatenate(rows),
        )

    @property
    def newest(self) -> Keyframe:
        """The keyframe that was added last."""
        return self.keyframes[max(self.keyframes)]

    def add(
        self, world_from_camera: Floats, features: Features, points: Floats, seen: Fix | None = None
    ) -> Keyframe:
        """Remember a picture, connected with the keyframes whose landmarks it sees; these become more exact.

        A picture that sees none begins a new segment.
        """
        owned = np.ones(len(features), np.bool_)
        segment = self._segments
        if seen is None:
            self._segments += 1
        else:
            owned[seen.features] = False
            segment = self.keyframes[seen.mainly].segment
        keyframe = Keyframe(self._next, segment, world_from_camera, features, points, owned)
        self._next += 1
        self.keyframes[keyframe.number] = keyframe
        if seen is not None:
            self._connect(keyframe, seen)
        return keyframe

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
        self._place(after)
        return True

    def _join(self, loop: Edge) -> None:
        """If the loop connects two segments, carry the later one to where it belongs beside the other."""
        first, second = (self.keyframes[number].segment for number in (loop.first, loop.second))
        if first == second:
            return
        poses = self._poses()
        second_there = poses[loop.first] @ loop.first_from_second
        correction = second_there @ inverse(poses[loop.second])
        if first > second:
            correction = inverse(correction)
        for keyframe in self.keyframes.values():
            if keyframe.segment == max(first, second):
                keyframe.segment = min(first, second)
                keyframe.world_from_camera = correction @ keyframe.world_from_camera

    def _anchors(self) -> list[int]:
        """The first keyframe of each segment."""
        firsts: dict[int, int] = {}
        for number, keyframe in self.keyframes.items():
            firsts.setdefault(keyframe.segment, number)
        return list(firsts.values())

    def _poses(self) -> dict[int, Floats]:
        return {number: keyframe.world_from_camera for number, keyframe in self.keyframes.items()}

    def _place(self, poses: Mapping[int, Floats]) -> None:
        for number, pose in poses.items():
            self.keyframes[number].world_from_camera = pose

    def _connect(self, keyframe: Keyframe, seen: Fix) -> None:
        for owner, count in seen.owners.items():
            other = self.keyframes[owner]
            other_from_new = inverse(other.world_from_camera) @ keyframe.world_from_camera
            if count >= MIN_SHARED or owner == seen.mainly:
                self.graph.add(Edge(owner, keyframe.number, other_from_new, count))
            mine = (seen.keyframes == owner) & np.isfinite(keyframe.weights[seen.features])
            sighted = seen.features[mine]
            places = apply(other_from_new, keyframe.points[sighted])
            other.sharpen(seen.rows[mine], places, keyframe.weights[sighted])
