"""When a pose that was found is not to be trusted: why, in a word that is published."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modules.slam.refinement import LEAST_SPREAD
from modules.slam.tracking import AGREEING

if TYPE_CHECKING:
    from modules.slam.tracking import Fix

FEW = 40
"""Landmarks that a pose needs: with fewer, some wrong ones decide."""
MISFIT = 1.6
"""Times the expected noise by which the landmarks that fit may miss their places."""
VAGUE = 0.05
"""Standard deviation of the shift, as a part of the landmarks' median distance, at which the view says too little."""
MOST_OFFSET = 2.5
"""Pixels of offset beyond which the right camera is not where the calibration says."""
UNCORRECTED = 0.5
"""The part of the offset, or of what it moved by lately, that may be wrong at any place: on a highway whose calibration
was off by 0.9 px it seemed to be 0.7 px here and 1.1 px there, and lenses err too."""
MOST_SCALE_SPREAD, NEAR = 0.01, 1.0
"""Standard deviation of the scale, in metres per metre of distance, above which a pose is doubted. Nearer to where the
map begins than these metres, the error in metres counts instead: it may be as large as at that distance."""
MATCHING = 0.5
"""The part of the landmarks whose distance, measured again in a new keyframe, must be what the movement makes of it."""
WORSE = 1.4
"""How many times larger the misfit may be with the new distances than by the movement alone: at most 1.2 on KITTI, and
1.37 where keyframes were few; 1.4 or more when the right camera was knocked by 0.7 pixels on the way."""
MOST_JUMP = 8.0
"""Standard deviations between the offset by the movement alone and the one with the new distances: at most 6.3 on
KITTI, 10 or more when the camera was knocked by half a pixel before the offset was known."""
MATCHED = 0.3
"""The part of a keyframe's corners that must have a depth: 0.49 or more on KITTI and EuRoC, 0.10 where a real rig's
pictures were identical, 0.09 where the right ones were 8 pixels too low."""


def doubt(fix: Fix, distance: float) -> str | None:
    """Why this pose, at this distance from where the map begins, may be wrong; None where nothing speaks against it."""
    reasons = (
        (fix.inliers < FEW, "few landmarks"),
        (fix.inliers < AGREEING * fix.tried, "landmarks disagree"),
        (fix.misfit > MISFIT, "landmarks do not fit"),
        (abs(fix.offset.pixels) > MOST_OFFSET, "cameras disagree"),
        (_vagueness(fix) > VAGUE, "view says too little"),
        (fix.keyframe.doubt is not None, fix.keyframe.doubt),
        (scale_spread(fix) * distance > MOST_SCALE_SPREAD * max(distance, NEAR), "scale uncertain"),
    )
    return next((reason for holds, reason in reasons if holds), None)


def scale_spread(fix: Fix) -> float:
    """How uncertain the scale of distances is (standard deviation, as a part): all disparities share their offset."""
    found = fix.offset
    wrong = UNCORRECTED * max(abs(found.pixels), found.moved)
    return float(np.hypot(max(found.spread, LEAST_SPREAD), wrong) / fix.disparity)


def _vagueness(fix: Fix) -> float:
    """How uncertain the shift is in its worst direction, as a part of the landmarks' median distance."""
    worst = float(np.sqrt(np.linalg.eigvalsh(fix.covariance[:3, :3])[-1]))
    return worst / float(np.median(fix.keyframe.points[:, 2]))


def stereo_doubt(fix: Fix, confirmed: Fix | None) -> str | None:
    """Why both cameras may have moved against each other, by what a new keyframe measures of known landmarks."""
    if confirmed is None:
        return "cameras disagree"
    shown, found = fix.offset, confirmed.offset.pixels
    contradictions = (
        confirmed.inliers < MATCHING * fix.inliers,
        confirmed.misfit > WORSE * fix.misfit,
        abs(found - shown.pixels) > MOST_JUMP * max(shown.spread, LEAST_SPREAD),
        abs(found) > MOST_OFFSET,
    )
    return "cameras disagree" if any(contradictions) else None


def depth_doubt(known: int, corners: int) -> str | None:
    """Why the calibration may be wrong, judged by how many of a keyframe's corners have a depth."""
    return "cameras disagree" if known < MATCHED * corners else None
