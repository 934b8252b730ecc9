"""Keyframes and how each lies from others, as a graph; and the poses that fit all of it best, by GTSAM."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING

import gtsam
import numpy as np

from modules.slam.geometry import angle, inverse, moved
from modules.slam.uncertainty import carried, chained

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from modules.slam.geometry import Floats


class Kind(Enum):
    """Why an edge is believed; with standard deviations in radians and metres, for an edge of 100 inliers."""

    SEEN = (0.002, 0.01)
    """A picture saw landmarks of another one."""
    LOOP = (0.004, 0.02)
    """A place was recognised; it is seen from another side, and after a longer time."""


@dataclass(frozen=True)
class Edge:
    """Two keyframes, and the pose of the second in the frame of the first."""

    first: int
    second: int
    first_from_second: Floats
    inliers: int
    kind: Kind = Kind.SEEN
    measured: Floats | None = None
    """The covariance of the second's pose, in its own axes, where it was measured."""

    @property
    def covariance(self) -> Floats:
        """How uncertain the second's pose is, seen from the first: of its shift, then turn."""
        return np.diag(np.roll(self.sigmas, 3) ** 2) if self.measured is None else self.measured

    @property
    def sigmas(self) -> Floats:
        """Standard deviations of three angles and three shifts: GTSAM's order."""
        sigmas: Floats = np.repeat(self.kind.value, 3) * np.sqrt(100 / max(self.inliers, 1))
        return sigmas

    def misfit(self, poses: Mapping[int, Floats]) -> float:
        """Squared distance of the poses from the edge's measurement, in standard deviations."""
        error = inverse(self.first_from_second) @ inverse(poses[self.first]) @ poses[self.second]
        turn, shift = self.sigmas[[0, 3]]
        return float((angle(error) / turn) ** 2 + (moved(error) / shift) ** 2)


class PoseGraph:
    """All edges. Numbers are those of keyframes."""

    def __init__(self) -> None:
        self._edges: dict[int, list[Edge]] = {}

    def add(self, edge: Edge) -> None:
        """Connect two keyframes."""
        for number in (edge.first, edge.second):
            self._edges.setdefault(number, []).append(edge)

    def remove(self, edge: Edge) -> None:
        """Disconnect two keyframes."""
        for number in (edge.first, edge.second):
            self._edges[number] = [other for other in self._edges[number] if other is not edge]

    def near(self, start: int, count: int) -> list[int]:
        """At most `count` keyframes in the order of their distance in edges, the start first."""
        found, waiting = {start: None}, deque([start])  # a dict keeps the order
        while waiting:
            for number in self._neighbours(waiting.popleft()):
                if len(found) == count:
                    return list(found)
                if number not in found:
                    found[number] = None
                    waiting.append(number)
        return list(found)

    def bypass(self, number: int) -> None:
        """Take a keyframe out: its neighbours are connected through its strongest neighbour instead."""
        edges = [_from(number, edge) for edge in self._edges.get(number, [])]
        for edge in list(self._edges.pop(number, [])):
            other = edge.second if edge.first == number else edge.first
            self._edges[other] = [kept for kept in self._edges[other] if kept is not edge]
        if edges:
            hub = max(edges, key=lambda edge: edge.inliers)
            for edge in edges:
                if edge.second != hub.second:
                    self.add(_through(hub, edge))

    def fitted(self, poses: Mapping[int, Floats], anchors: Iterable[int]) -> dict[int, Floats]:
        """Poses (`world_from_camera`) that fit all edges best, by least squares; anchors stay where they are.

        Each connected part needs an anchor.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for number, pose in poses.items():
            values.insert(number, gtsam.Pose3(pose))
        for anchor in anchors:
            graph.addPriorPose3(anchor, gtsam.Pose3(poses[anchor]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6))
        for edge in self._all():
            noise = gtsam.noiseModel.Diagonal.Sigmas(edge.sigmas)
            between = gtsam.Pose3(edge.first_from_second)
            graph.add(gtsam.BetweenFactorPose3(edge.first, edge.second, between, noise))
        found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        return {number: found.atPose3(number).matrix() for number in poses}

    def uncertainties(self, known: Mapping[int, Floats]) -> dict[int, Floats]:
        """Covariances of all keyframes that edges lead to from those whose covariance is known, along the surest way.

        It is at most as good as what all ways together would give.
        """
        found = dict(known)
        waiting = [(_spread(covariance), number) for number, covariance in known.items()]
        heapify(waiting)
        while waiting:
            spread, number = heappop(waiting)
            if spread > _spread(found[number]):
                continue
            for edge in (_from(number, edge) for edge in self._edges.get(number, [])):
                there = chained(found[number], edge.covariance, edge.first_from_second)
                if edge.second not in found or _spread(there) < _spread(found[edge.second]):
                    found[edge.second] = there
                    heappush(waiting, (_spread(there), edge.second))
        return found

    def strain(self, poses: Mapping[int, Floats]) -> float:
        """How much the poses contradict the edges: the sum of squared misfits, each in standard deviations."""
        return sum(edge.misfit(poses) for edge in self._all())

    def _neighbours(self, number: int) -> Iterator[int]:
        edges = [_from(number, edge) for edge in self._edges.get(number, [])]
        return (edge.second for edge in sorted(edges, key=lambda edge: -edge.inliers))

    def _all(self) -> Iterator[Edge]:
        return (edge for number, edges in self._edges.items() for edge in edges if edge.first == number)


def _from(number: int, edge: Edge) -> Edge:
    """The same edge, seen from this end."""
    if edge.first == number:
        return edge
    covariance = carried(edge.covariance, edge.first_from_second)
    return Edge(number, edge.first, inverse(edge.first_from_second), edge.inliers, edge.kind, covariance)


def _spread(covariance: Floats) -> float:
    """How uncertain the place is, in m2."""
    return float(np.trace(covariance[:3, :3]))


def _through(first: Edge, second: Edge) -> Edge:
    """Two edges from one keyframe, as one edge between their ends: as uncertain as both together."""
    inliers = round(1 / (1 / max(first.inliers, 1) + 1 / max(second.inliers, 1)))
    kind = max(first.kind, second.kind, key=lambda kind: kind.value)
    way = inverse(first.first_from_second) @ second.first_from_second
    covariance = chained(
        carried(first.covariance, first.first_from_second), second.covariance, second.first_from_second
    )
    return Edge(first.second, second.second, way, inliers, kind, covariance)
