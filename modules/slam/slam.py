"""Simultaneous localisation and mapping with two cameras: the steps, in their order.

A picture is located by the landmarks around (tracking). If it shows enough new, it becomes a keyframe, and its corners
become landmarks with the depth that the second picture gives. When there is time, keyframes are compared with older
ones; a place that is recognised closes a loop, and the map is straightened. A camera that is lost looks for a place
that it knows; if it finds none, it starts anew beside the old map, until a loop joins both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from modules.slam.features import detect, measure
from modules.slam.geometry import inverse
from modules.slam.keyframes import shows_new
from modules.slam.local_map import Map
from modules.slam.loop_closing import LoopCloser
from modules.slam.places import Places
from modules.slam.relocalisation import Relocaliser
from modules.slam.tracking import Tracker

if TYPE_CHECKING:
    from collections.abc import Callable

    from modules.slam.calibration import Rectifier
    from modules.slam.features import Features
    from modules.slam.geometry import Floats, Image
    from modules.slam.keyframes import Keyframe
    from modules.slam.tracking import Fix

CAPACITY = 1000
"""Keyframes that are remembered; each takes about 0.1 MB."""
PATIENCE = 10
"""Pictures without a known place after which a lost camera starts anew."""
MIN_POINTS = 50
"""Points with depth that a picture needs to start from."""


class State(Enum):
    """How much the pose can be trusted."""

    TRACKING = "tracking"
    LOST = "lost"
    """The pose is the last that was known."""
    ADRIFT = "adrift"
    """The camera was lost and started anew from its last pose; a loop will tell where that is."""


@dataclass(frozen=True)
class Effort:
    """How much work a picture gets: corners to look for, and the part of a keyframe's view that must be left."""

    features: int = 800
    overlap: float = 0.5


@dataclass(frozen=True)
class Pose:
    """The robot's body in the frame of its first picture; `inliers` is 0 when it is lost."""

    world_from_body: Floats
    inliers: int
    state: State


class StereoSlam:
    """Takes pictures one by one; `effort` may change between them."""

    def __init__(self, rectifier: Rectifier, effort: Effort = Effort()) -> None:
        self.effort = effort
        self.map = Map(CAPACITY)
        self._rectifier = rectifier
        self._tracker = Tracker(rectifier.matrix, rectifier.size)
        self._places = Places()
        self._relocaliser = Relocaliser(self.map, self._places, self._tracker)
        self.loops = LoopCloser(self.map, self._relocaliser)
        self._reference: Keyframe | None = None
        self._reference_from_camera = rectifier.body_from_camera
        self._motion = np.eye(4)
        self._lost = 0

    def track(self, left: Image, right: Callable[[], Image]) -> Pose:
        """Take a pair of raw pictures; the right one is asked for only when it is needed, for a new keyframe."""
        image = self._rectifier.left(left)
        features = detect(image, self.effort.features)
        fix = self._locate(features)
        if self._is_needed(fix):
            points = measure(self._rectifier, image, self._rectifier.right(right()), features)
            self._follow(fix)
            self._keep(features, points, fix)
        else:
            self._follow(fix)
        return self._pose(fix)

    def close_loop(self) -> bool:
        """Look for a loop, in spare time; returns whether one was closed."""
        return self.loops.work()

    @property
    def world_from_camera(self) -> Floats:
        """Where the left camera is; it moves with the keyframe that it is seen from when the map is straightened."""
        known = self._reference
        return self._reference_from_camera if known is None else known.world_from_camera @ self._reference_from_camera

    def _locate(self, features: Features) -> Fix | None:
        """By the landmarks around; else, or after it was lost, anywhere in the map."""
        if self._reference is None:
            return None
        fix = None
        if not self._lost:
            expected = self.world_from_camera @ self._motion
            fix = self._tracker.track(features, self.map.around(self._reference.number), expected)
        return fix or self._relocaliser.find(features, self.map.keyframes)

    def _is_needed(self, fix: Fix | None) -> bool:
        """Whether the picture should become a keyframe: to begin with, to start anew, or because it shows new things."""
        if fix is None or self._reference is None:
            return self._reference is None or self._lost >= PATIENCE
        last, expected = self.map.newest, len(self._reference.known)
        return shows_new(fix.world_from_camera, last, inliers=len(fix), expected=expected, overlap=self.effort.overlap)

    def _follow(self, fix: Fix | None) -> None:
        """Go to where the fix is, seen from the keyframe whose landmarks it sees most of."""
        if fix is None:
            self._lost += self._reference is not None
            self._motion = np.eye(4)
            return
        self._motion = np.eye(4) if self._lost else inverse(self.world_from_camera) @ fix.world_from_camera
        self._lost = 0
        self._refer(self.map.keyframes[fix.mainly], fix.world_from_camera)

    def _refer(self, keyframe: Keyframe, world_from_camera: Floats) -> None:
        self._reference = keyframe
        self._reference_from_camera = inverse(keyframe.world_from_camera) @ world_from_camera

    def _keep(self, features: Features, points: Floats, fix: Fix | None) -> None:
        """Make a picture with enough depth a keyframe; without a fix it starts anew from the last pose."""
        if np.isfinite(points[:, 2]).sum() < MIN_POINTS:
            return
        keyframe = self.map.add(self.world_from_camera, features, points, fix)
        self._places.add(keyframe.number, features.descriptors)
        self.loops.remember(keyframe)
        self._refer(keyframe, keyframe.world_from_camera)
        self._lost = 0
        forgotten = self.map.forget()
        if forgotten is not None:
            self._places.forget(forgotten)

    def _pose(self, fix: Fix | None) -> Pose:
        world_from_body = self.world_from_camera @ inverse(self._rectifier.body_from_camera)
        if self._reference is None or self._lost:
            return Pose(world_from_body, 0, State.LOST)
        inliers = len(self._reference.known) if fix is None else len(fix)  # a new start is where it is by definition
        return Pose(world_from_body, inliers, State.ADRIFT if self._reference.segment else State.TRACKING)
