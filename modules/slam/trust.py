"""When a pose that was found is not to be trusted: why, in a word that is published."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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
MATCHING = 0.5
"""The part of the landmarks whose distance, measured again in a new keyframe, must be what the movement makes of it."""


def doubt(fix: Fix) -> str | None:
    """Why this pose may be wrong; None where nothing speaks against it."""
    if fix.inliers < FEW:
        return "few landmarks"
    if fix.inliers < AGREEING * fix.tried:
        return "landmarks disagree"
    if fix.misfit > MISFIT:
        return "landmarks do not fit"
    if abs(fix.offset.pixels) > MOST_OFFSET:
        return "cameras disagree"
    if _vagueness(fix) > VAGUE:
        return "view says too little"
    return fix.keyframe.doubt


def _vagueness(fix: Fix) -> float:
    """How uncertain the shift is in its worst direction, as a part of the landmarks' median distance."""
    worst = float(np.sqrt(np.linalg.eigvalsh(fix.covariance[:3, :3])[-1]))
    return worst / float(np.median(fix.keyframe.points[:, 2]))


def stereo_doubt(fix: Fix, confirmed: Fix) -> str | None:
    """Why both cameras may have moved against each other, by what a new keyframe measures of known landmarks."""
    differs = confirmed.inliers < MATCHING * fix.inliers or abs(confirmed.offset.pixels) > MOST_OFFSET
    return "cameras disagree" if differs else None
