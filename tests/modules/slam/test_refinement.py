"""Poses of landmarks with noise, on made-up geometry: a focal length of 700 pixels, another camera 0.5 m beside."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from modules.slam.geometry import apply, floats, inverse, transform
from modules.slam.refinement import DISPARITY_NOISE, PIXEL_NOISE, Refiner, Sightings

FOCAL, BASELINE, CENTRE = 700.0, 0.5, (600.0, 180.0)
MATRIX = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])
AHEAD = transform(floats(cv2.Rodrigues(np.array([0.0, 0.03, 0.01]))[0]), np.array([0.1, 0.0, 1.5]))


def projected(points):
    return points[:, :2] / points[:, 2:] * FOCAL + CENTRE, FOCAL * BASELINE / points[:, 2]


def sightings(rng, *, near=6.0, far=150.0, noise=1.0, both=False):
    """Landmarks from near to far, evenly in their disparity, and where a camera that has moved sees them."""
    moved, count = AHEAD, 300
    disparities = rng.uniform(FOCAL * BASELINE / far, FOCAL * BASELINE / near, count)
    rays = np.column_stack([rng.uniform(-0.8, 0.8, count), rng.uniform(-0.25, 0.25, count), np.ones(count)])
    points = rays * (FOCAL * BASELINE / disparities)[:, None]
    seen, there = projected(apply(inverse(moved), points))
    there = there + rng.normal(0, noise * DISPARITY_NOISE, count) if both else np.full(count, np.nan)
    return Sightings(
        projected(points)[0],
        disparities + rng.normal(0, noise * DISPARITY_NOISE, count),
        seen + rng.normal(0, noise * PIXEL_NOISE, (count, 2)),
        there,
    )


def shifts(turn, pixels, disparities):
    """Pixels that disparities grow by when the right camera is turned by this angle."""
    angles = np.arctan((pixels[:, 0] - disparities - CENTRE[0]) / FOCAL)
    return FOCAL * (np.tan(angles) - np.tan(angles + turn))


@pytest.fixture
def refiner():
    camera: Any = SimpleNamespace(matrix=MATRIX, baseline=BASELINE)
    return Refiner(camera)


def test_without_noise_the_pose_is_exact(refiner):
    fitted = refiner.fit(sightings(np.random.default_rng(1), noise=0, both=True), np.eye(4))
    assert fitted.keyframe_from_camera == pytest.approx(AHEAD, abs=1e-6)
    assert fitted.fits.all()


def test_a_right_camera_turned_sideways_shifts_disparities_more_towards_the_sides(refiner):
    turn, whole = -0.0012, sightings(np.random.default_rng(8), noise=0, both=True)
    turned = replace(
        whole,
        disparities=whole.disparities + shifts(turn, whole.pixels, whole.disparities),
        seen_disparities=whole.seen_disparities + shifts(turn, whole.seen, whole.seen_disparities),
    )
    fitted = refiner.fit(turned, np.eye(4))
    assert fitted.offset.pixels == pytest.approx(-FOCAL * turn, abs=0.04)
    assert fitted.keyframe_from_camera[2, 3] == pytest.approx(AHEAD[2, 3], rel=0.003)


@pytest.mark.parametrize("both", [False, True])
def test_errors_are_as_large_as_the_covariance_says(refiner, both):
    rng, errors, spreads = np.random.default_rng(2), [], []
    for _ in range(60):
        fitted = refiner.fit(sightings(rng, both=both), np.eye(4))
        error = inverse(AHEAD) @ fitted.keyframe_from_camera
        errors.append(np.concatenate([error[:3, 3], cv2.Rodrigues(error[:3, :3])[0].ravel()]))
        spreads.append(fitted.covariance)
    ratio = np.std(errors, axis=0) / np.sqrt(np.diag(np.mean(spreads, axis=0)))
    assert (ratio > 0.6).all()
    assert (ratio < 1.5).all()


def test_far_landmarks_do_not_stretch_the_path(refiner):
    rng = np.random.default_rng(3)
    lengths = [refiner.fit(sightings(rng, near=15, far=400), np.eye(4)).keyframe_from_camera[2, 3] for _ in range(60)]
    assert np.mean(lengths) == pytest.approx(AHEAD[2, 3], rel=0.01)


def test_outlier_landmarks_are_ignored(refiner):
    whole = sightings(np.random.default_rng(4))
    whole.seen[:60] += 25
    fitted = refiner.fit(whole, AHEAD)
    assert not fitted.fits[:60].any()
    assert fitted.fits[60:].mean() > 0.95
    assert fitted.keyframe_from_camera == pytest.approx(AHEAD, abs=0.05)


def test_a_second_stereo_picture_reduces_the_covariance(refiner):
    one, two = (
        refiner.fit(sightings(np.random.default_rng(5), both=both), np.eye(4)).covariance[2, 2]
        for both in (False, True)
    )
    assert two < 0.8 * one


def test_few_and_far_landmarks_are_less_sure(refiner):
    near, far = (
        refiner.fit(sightings(np.random.default_rng(6), near=at, far=2 * at), np.eye(4)).covariance[2, 2]
        for at in (5.0, 60.0)
    )
    assert far > 10 * near


def test_noise_beyond_what_is_expected_widens_the_covariance(refiner):
    fitted = refiner.fit(sightings(np.random.default_rng(7), noise=1.6), np.eye(4))
    assert fitted.misfit > 1.3
    expected = refiner.fit(sightings(np.random.default_rng(7)), np.eye(4))
    assert fitted.covariance[0, 0] > 1.5 * expected.covariance[0, 0]
