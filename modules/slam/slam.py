"""Simultaneous localisation and mapping with two cameras: the steps, in their order.

A picture is located by the landmarks around (tracking). If it shows enough new, it becomes a keyframe, and its corners
become landmarks with the depth that the second picture gives. When there is time, keyframes are compared with older
ones; a place that is recognised closes a loop, and the map is straightened. A camera that is lost looks for a place
that it knows; if it finds none, it starts over beside the old map, until a loop joins both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from modules.slam.features import MIN_DISPARITY, Picture, balanced, measure
from modules.slam.geometry import inverse
from modules.slam.keyframes import has_moved
from modules.slam.loop_closing import LoopCloser
from modules.slam.map import Map
from modules.slam.places import Places
from modules.slam.refinement import turn_shifts
from modules.slam.relocalisation import Relocaliser
from modules.slam.tracking import Tracker
from modules.slam.trust import depth_doubt, doubt, scale_spread, stereo_doubt
from modules.slam.uncertainty import carried, stretched, turned

if TYPE_CHECKING:
    from collections.abc import Callable

    from modules.slam.calibration import Rectifier
    from modules.slam.geometry import Floats, Image
    from modules.slam.keyframes import Keyframe
    from modules.slam.tracking import Fix

CAPACITY = 1000
"""Keyframes that are remembered; each takes about 85 kB."""
PATIENCE = 10
"""Pictures without a known place after which a lost camera starts over."""
BESIDE = 2
"""Keyframes beside the reference that are tried when its view is left."""
MIN_POINTS = 50
"""Points with depth that a picture needs to start from."""


class State(Enum):
    """How much the pose can be trusted."""

    TRACKING = "tracking"
    LOST = "lost"
    """The pose is the last that was known."""
    DEGRADED = "degraded"
    """The pose was found, but something speaks against it."""
    ADRIFT = "adrift"
    """The camera was lost and started over from its last pose; a loop will show where that is."""


@dataclass(frozen=True)
class Effort:
    """How much work a picture gets: corners to look for, and the part of a keyframe's view that must be left."""

    features: int = 800
    overlap: float = 0.75


@dataclass(frozen=True)
class Pose:
    """The robot's body in the frame of its first picture; `inliers` is 0 when it is lost."""

    world_from_body: Floats
    inliers: int
    state: State
    is_keyframe: bool
    covariance: Floats | None = None
    """Of x, y, z and the turns about these axes, as ROS has it (m2, rad2); None when lost."""
    doubt: str | None = None


class StereoSlam:
    """Takes pictures one by one; `effort` may change between them."""

    def __init__(self, rectifier: Rectifier, effort: Effort = Effort()) -> None:
        self.effort = effort
        self.size = rectifier.size
        """Width and height of the raw pictures."""
        self.map = Map(CAPACITY)
        self._rectifier = rectifier
        self._tracker = Tracker(rectifier)
        self._places = Places()
        self._relocaliser = Relocaliser(self.map, self._places, self._tracker)
        self.loops = LoopCloser(self.map, self._relocaliser)
        self._reference: Keyframe | None = None
        self._reference_from_camera = rectifier.body_from_camera
        self._motion = np.eye(4)
        self._lost = 0

    def track(self, left: Image, right: Callable[[], Image]) -> Pose:
        """Take a pair of raw pictures; the right one is asked for only when it is needed, for a new keyframe."""
        rectified = self._rectifier.left(left)
        picture = Picture(rectified, self.effort.features)
        fixes = self._locate(picture)
        beside = self._beside(right(), rectified) if self._is_needed(fixes) else None
        self._follow(fixes)
        kept, why = (False, None) if beside is None else self._keep(picture, beside, fixes)
        return self._pose(fixes, why, is_keyframe=kept)

    def _beside(self, right: Image, left: Image) -> Picture:
        return Picture(balanced(self._rectifier.right(right), left), self.effort.features)

    def close_loop(self) -> bool:
        """Look for a loop, in spare time; returns whether one was closed."""
        return self.loops.work()

    @property
    def world_from_camera(self) -> Floats:
        """Where the left camera is; it moves with the keyframe that it is seen from when the map is straightened."""
        known = self._reference
        return self._reference_from_camera if known is None else known.world_from_camera @ self._reference_from_camera

    def _locate(self, picture: Picture) -> list[Fix]:
        """Seen from the reference; from others beside it too, if its view is left; best first. Else anywhere."""
        if self._reference is None:
            return []
        fixes = [] if self._lost else self._fixes(picture, self._reference)
        if not fixes:
            found = self._relocaliser.find(picture, self.map.keyframes)
            fixes = [] if found is None else [found]
        return sorted(fixes, key=lambda fix: -fix.inliers)

    def _fixes(self, picture: Picture, reference: Keyframe) -> list[Fix]:
        expected = self.world_from_camera @ self._motion
        fix = self._tracker.track(picture, reference, expected)
        if fix is not None and not self._is_left(fix):
            return [fix]
        beside = self.map.beside(reference, expected if fix is None else fix.world_from_camera, BESIDE)
        others = [self._tracker.track(picture, other, expected) for other in beside]
        return [one for one in (fix, *others) if one is not None]

    def _is_left(self, fix: Fix) -> bool:
        """Whether too little of a keyframe's view is in the picture, as far as its corners were looked for."""
        return fix.inliers < self.effort.overlap * min(len(fix.keyframe), self.effort.features)

    def _is_needed(self, fixes: list[Fix]) -> bool:
        """Whether the picture should become a keyframe: to begin with, to start over, or because it shows much new."""
        if not fixes:
            return self._reference is None or self._lost >= PATIENCE
        return self._is_left(fixes[0]) and has_moved(fixes[0].world_from_camera, self.map.newest)

    def _follow(self, fixes: list[Fix]) -> None:
        """Go to where the best fix is."""
        if not fixes:
            self._lost += self._reference is not None
            self._motion = np.eye(4)
            return
        best = fixes[0]
        self._motion = np.eye(4) if self._lost else inverse(self.world_from_camera) @ best.world_from_camera
        self._lost = 0
        self._reference, self._reference_from_camera = best.keyframe, best.keyframe_from_camera

    def _keep(self, picture: Picture, beside: Picture, fixes: list[Fix]) -> tuple[bool, str | None]:
        """Make a picture with enough depth a keyframe, or say why it has little, if the right camera may have failed.

        Without a fix it starts over from the last pose.
        """
        why = self._confirm(picture, beside, fixes)
        offset = self._tracker.offset.pixels
        disparities = measure(picture, beside) - offset * turn_shifts(self._rectifier.matrix, picture.features.pixels)
        disparities[disparities < MIN_DISPARITY] = np.nan
        points = self._rectifier.in_space(picture.features.pixels, disparities)
        known = int(np.isfinite(points[:, 2]).sum())
        why = why or depth_doubt(known, len(points))
        if known < MIN_POINTS:
            return False, why
        keyframe = self.map.add(self.world_from_camera, picture, points, fixes)
        keyframe.doubt, keyframe.offset = why, offset
        self._places.add(keyframe.number, picture.features.descriptors)
        self.loops.remember(keyframe)
        self._reference, self._reference_from_camera = keyframe, np.eye(4)
        self._lost = 0
        forgotten = self.map.forget()
        if forgotten is not None:
            self._places.forget(forgotten)
        return True, None

    def _confirm(self, picture: Picture, beside: Picture, fixes: list[Fix]) -> str | None:
        """Correct the best fix by the second picture, or return why the two cameras contradict each other."""
        if not fixes:
            return None
        confirmed, known = self._tracker.confirm(fixes[0], picture, beside), self._tracker.offset
        why = stereo_doubt(fixes[0], confirmed)
        if confirmed is None or why is not None:
            self._tracker.offset = known.forgotten()  # may have changed: learn it again
            return why
        fixes[0] = confirmed
        self._reference_from_camera = confirmed.keyframe_from_camera
        self._tracker.offset = known.learned(confirmed.offset)
        return None

    def _pose(self, fixes: list[Fix], failed: str | None, *, is_keyframe: bool) -> Pose:
        body_from_camera = self._rectifier.body_from_camera
        world_from_body = self.world_from_camera @ inverse(body_from_camera)
        reference = self._reference
        if reference is None or self._lost:
            return Pose(world_from_body, 0, State.LOST, is_keyframe=False)
        inliers = fixes[0].inliers if fixes else len(reference)  # a new start is where it is by definition
        covariance = fixes[0].covariance_in_map if fixes else reference.covariance
        why = doubt(fixes[0], float(np.linalg.norm(world_from_body[:3, 3]))) if fixes else reference.doubt
        why = why or failed
        state = State.ADRIFT if reference.segment else State.DEGRADED if why else State.TRACKING
        in_world = turned(carried(covariance, body_from_camera), world_from_body)
        if fixes:
            in_world = stretched(in_world, world_from_body[:3, 3], scale_spread(fixes[0]))
        return Pose(world_from_body, inliers, state, is_keyframe, in_world, why)
