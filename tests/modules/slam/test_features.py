"""Disparities of a made-up pair: noise as a wall whose left half is nearer than its right half."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from modules.slam.features import MOST_GAIN, Picture, balanced, measure

NEAR, FAR = 24.4, 7.7


def wall():
    noise = cv2.GaussianBlur(np.random.default_rng(1).normal(size=(240, 640)), (0, 0), 2)
    return np.clip(128 + 50 * noise / noise.std(), 0, 255).astype(np.uint8)


def moved(picture, columns, rows=0.0):
    return cv2.warpAffine(picture, np.array([[1.0, 0, columns], [0, 1, rows]]), picture.shape[::-1])


def pair(near=NEAR, far=FAR, rows=0.0):
    left = wall()
    right = np.hstack([moved(left, -near)[:, :300], moved(left, -far)[:, 300:]])
    return Picture(left, 400), Picture(moved(right, 0, rows), 400)


def test_disparities_are_exact_to_a_part_of_a_pixel():
    left, right = pair()
    columns, disparities = left.features.pixels[:, 0], measure(left, right)
    for half, disparity in ((columns < 290, NEAR), (columns > 340, FAR)):
        known = disparities[half & np.isfinite(disparities)]
        assert len(known) > 0.6 * half.sum()
        assert np.median(known) == pytest.approx(disparity, abs=0.05)
        assert (np.abs(known - disparity) < 0.5).mean() > 0.95


@pytest.mark.parametrize("gain", [0.5, 1.3])
def test_disparities_do_not_depend_on_how_bright_the_second_picture_is(gain):
    left, right = pair()
    brighter = Picture(balanced(cv2.convertScaleAbs(right.image, alpha=gain), left.image), 400)
    same, other = measure(left, right), measure(left, brighter)
    assert (np.isfinite(other) == np.isfinite(same)).mean() > 0.9
    assert np.nanmedian(np.abs(other - same)) < 0.05


def test_equally_bright_pictures_stay_so_where_most_of_them_is_black():
    image = wall()
    image[:, 100:] = 0
    assert (balanced(image, image) == image).all()
    assert balanced(image // 2, image).mean() == pytest.approx(image.mean(), rel=0.02)


def test_a_black_picture_and_a_picture_beside_a_black_one_stay_as_they_are():
    black = np.zeros((48, 64), np.uint8)
    assert not balanced(black, wall()).any()
    assert (balanced(wall(), black) == wall()).all()


def test_a_picture_without_light_stays_dark():
    assert balanced(np.full((48, 64), 1, np.uint8), wall()).max() == MOST_GAIN


@pytest.mark.parametrize("wrong", [{"near": 0, "far": 0}, {"near": -6, "far": -6}, {"rows": 8}])
def test_implausible_matches_have_no_disparity(wrong):
    assert np.isfinite(measure(*pair(**wrong))).mean() < 0.05
