"""Closing loops: a keyframe that shows a place from long ago reveals how far the path has drifted since."""

from __future__ import annotations

import logging
from collections import deque
from typing import TYPE_CHECKING

from modules.slam.pose_graph import Kind

if TYPE_CHECKING:
    from modules.slam.keyframes import Keyframe
    from modules.slam.map import Map
    from modules.slam.relocalisation import Relocaliser

RECENT = 20
"""Keyframes this near in the graph are no loop."""
MOST_PENDING = 50
"""Keyframes that wait to be looked at; older ones are given up."""
_LOG = logging.getLogger(__name__)


class LoopCloser:
    """Looks at keyframes when there is time, and straightens the map when one of them closes a loop."""

    def __init__(self, known: Map, relocaliser: Relocaliser) -> None:
        self.closed = 0
        """Loops closed so far."""
        self._map = known
        self._relocaliser = relocaliser
        self._pending: deque[int] = deque(maxlen=MOST_PENDING)

    def remember(self, keyframe: Keyframe) -> None:
        """Look at a keyframe later."""
        self._pending.append(keyframe.number)

    def work(self) -> bool:
        """Look at the newest keyframe that waits; returns whether it closed a loop."""
        while self._pending:
            keyframe = self._map.keyframes.get(self._pending.pop())
            if keyframe is not None:
                return self._close(keyframe)
        return False

    def _close(self, keyframe: Keyframe) -> bool:
        recent = set(self._map.graph.near(keyframe.number, RECENT))
        known = [number for number in self._map.keyframes if number not in recent]
        fix = self._relocaliser.find(keyframe, known)
        if fix is None:
            return False
        number = fix.keyframe.number
        loop = fix.edge_to(keyframe.number, Kind.LOOP)
        closed = self._map.close(loop)
        self.closed += closed
        _LOG.info("keyframes %d and %d: a loop %s", number, keyframe.number, "closed" if closed else "that cannot be")
        return closed
