"""Where in the known map a picture was taken: by places that look alike, then by geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modules.slam.geometry import apply
from modules.slam.tracking import Landmarks

if TYPE_CHECKING:
    from collections.abc import Iterable

    from modules.slam.features import Features
    from modules.slam.keyframes import Keyframe
    from modules.slam.local_map import Map
    from modules.slam.places import Places
    from modules.slam.tracking import Fix, Tracker

CANDIDATES = 3
"""Keyframes that look alike and are examined more closely."""
MIN_INLIERS = 50
"""Landmarks around the candidate that must be where they should; chance finds fewer than 20."""


class Relocaliser:
    """Recognises places of the map."""

    def __init__(self, known: Map, places: Places, tracker: Tracker) -> None:
        self._map = known
        self._places = places
        self._tracker = tracker

    def find(self, features: Features, among: Iterable[int]) -> Fix | None:
        """Where the picture was taken, if it shows what is around one of these keyframes."""
        for number in self._places.alike(features.descriptors, among, CANDIDATES):
            fix = self._examine(features, self._map.keyframes[number])
            if fix is not None:
                return fix
        return None

    def _examine(self, features: Features, candidate: Keyframe) -> Fix | None:
        """First with all that the candidate saw, wherever in the picture; then with all landmarks around, in place."""
        first = self._tracker.locate(features, _all_of(candidate))
        if first is None:
            return None
        around = self._map.around(candidate.number)
        fix = self._tracker.confirm(features, around, first.world_from_camera)
        return fix if fix is not None and len(fix) >= MIN_INLIERS else None


def _all_of(keyframe: Keyframe) -> Landmarks:
    """All that a keyframe saw, as if it owned it."""
    rows = keyframe.known
    places = apply(keyframe.world_from_camera, keyframe.points[rows])
    return Landmarks(places, keyframe.descriptors(rows), np.full(len(rows), keyframe.number), rows)
