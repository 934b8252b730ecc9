"""The least that SLAM has to beat: visual odometry as tutorials have it, from one picture to the next.

Corners by Shi and Tomasi, followed by optical flow (Lucas-Kanade, forth and back); depth by semi-global block matching;
the camera by PnP. It has no keyframes, no map, no loops, and knows nothing of uncertainty.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from modules.slam.geometry import floats, inverse, transform

if TYPE_CHECKING:
    from modules.slam.calibration import Rectifier
    from modules.slam.geometry import Floats, Image

CORNERS, MIN_DISTANCE, MIN_DISPARITY, MIN_POINTS = 1000, 10, 1.0, 10
WINDOW, FLOW_ERROR, REPROJECTION = (21, 21), 0.5, 1.0


class Baseline:
    """Takes pairs of raw pictures one by one."""

    def __init__(self, rectifier: Rectifier) -> None:
        self._rectifier = rectifier
        self._matcher = cv2.StereoSGBM.create(0, 128, 5, 8 * 25, 32 * 25, disp12MaxDiff=1, uniquenessRatio=10)
        self._last: tuple[Image, Floats] | None = None
        self._world_from_camera = rectifier.body_from_camera

    def track(self, left: Image, right: Image) -> Floats | None:
        """`world_from_body`; None where the movement since the last picture could not be found."""
        image, other = self._rectifier.left(left), self._rectifier.right(right)
        disparity = self._matcher.compute(image, other).astype(np.float64) / 16
        moved = np.eye(4) if self._last is None else self._movement(*self._last, image)
        self._last = (image, disparity)
        if moved is None:
            return None
        self._world_from_camera = self._world_from_camera @ moved
        return self._world_from_camera @ inverse(self._rectifier.body_from_camera)

    def _movement(self, before: Image, disparity: Floats, image: Image) -> Floats | None:
        corners = cv2.goodFeaturesToTrack(before, CORNERS, 0.01, MIN_DISTANCE)
        if corners is None:
            return None
        found, forth, _ = cv2.calcOpticalFlowPyrLK(before, image, corners, corners.copy(), winSize=WINDOW)
        again, back, _ = cv2.calcOpticalFlowPyrLK(image, before, found, found.copy(), winSize=WINDOW)
        start, end = corners.reshape(-1, 2), found.reshape(-1, 2)
        shifts = disparity[tuple(np.round(start).astype(int).T[::-1])]
        sure = np.linalg.norm(again.reshape(-1, 2) - start, axis=1) < FLOW_ERROR
        kept = sure & (forth.ravel() == 1) & (back.ravel() == 1) & (shifts > MIN_DISPARITY)
        return self._solve(start[kept].astype(np.float64), shifts[kept], end[kept].astype(np.float64))

    def _solve(self, pixels: Floats, shifts: Floats, seen: Floats) -> Floats | None:
        matrix = self._rectifier.matrix
        if len(pixels) < MIN_POINTS:
            return None
        rays = np.column_stack([(pixels - matrix[:2, 2]) / matrix[0, 0], np.ones(len(pixels))])
        points = rays * (matrix[0, 0] * self._rectifier.baseline / shifts)[:, None]
        found, turn, shift, _ = cv2.solvePnPRansac(
            points, seen, matrix, None, iterationsCount=200, reprojectionError=REPROJECTION, confidence=0.999
        )
        return inverse(transform(floats(cv2.Rodrigues(turn)[0]), floats(shift))) if found else None
