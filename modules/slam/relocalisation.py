"""Where in the known map a picture was taken: by places that look alike, then by geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from modules.slam.features import View
    from modules.slam.map import Map
    from modules.slam.places import Places
    from modules.slam.tracking import Fix, Tracker

CANDIDATES = 3
"""Keyframes that look alike and are examined more closely."""
MIN_INLIERS = 50
"""Landmarks of a candidate that must be where they should; chance finds fewer than 20."""


class Relocaliser:
    """Recognises places of the map."""

    def __init__(self, known: Map, places: Places, tracker: Tracker) -> None:
        self._map = known
        self._places = places
        self._tracker = tracker

    def find(self, view: View, among: Iterable[int]) -> Fix | None:
        """Where a view is from, if it shows what one of these keyframes shows."""
        for number in self._places.alike(view.features.descriptors, among, CANDIDATES):
            fix = self._tracker.search(view, self._map.keyframes[number])
            if fix is not None and fix.inliers >= MIN_INLIERS:
                return fix
        return None
