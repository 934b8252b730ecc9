"""Cutting texts out upright, and turning columns of probabilities into characters."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from modules.signs.detector import Region, boxes
from modules.signs.reading import decode, upright


def columns(*reported):
    table = np.full((len(reported), 11), 0.01, np.float32)
    for row, (label, likely) in zip(table, reported, strict=True):
        row[label] = likely
    return table


def test_ctc_decoding_merges_runs_and_splits_at_blanks():
    reading = decode(
        columns((10, 0.9), (1, 0.6), (1, 0.9), (10, 0.8), (1, 0.7), (10, 1), (10, 1), (4, 0.8)), "0123456789", 10
    )
    assert reading.text == "114"
    assert reading.confidence == pytest.approx(0.7)
    assert [round(one.position, 2) for one in reading.characters] == [0.25, 0.56, 0.94]


def test_blank_columns_decode_to_empty_text():
    reading = decode(columns((10, 0.9), (10, 0.9)), "0123456789", 10)
    assert (reading.text, reading.confidence) == ("", 0)


def test_positions_refer_to_the_unpadded_text():
    reading = decode(columns((3, 0.9), (10, 0.9), (10, 0.9), (10, 0.9)), "0123456789", 10).stretched(2)
    assert [one.position for one in reading.characters] == [0.25]


@pytest.mark.parametrize("angle", [0, 20, -35])
def test_a_text_is_cut_out_upright(angle):
    picture = np.zeros((200, 300, 3), np.uint8)
    corners = cv2.boxPoints(((150, 100), (120, 40), angle))
    ordered = np.roll(corners, -1, axis=0).astype(np.float32)  # OpenCV begins at the lower left
    left = ordered + (ordered[[1, 0, 3, 2]] - ordered) * np.array([[0], [0.5], [0.5], [0]])
    cv2.fillPoly(picture, [left.astype(np.int32)], (255, 255, 255))
    cut = upright(picture, ordered, 48)
    assert cut.shape[0] == 48
    assert abs(cut.shape[1] - 144) <= 1
    assert cut[:, 10:60].mean() > 200
    assert cut[:, 84:134].mean() < 30


def test_a_sliver_and_an_endless_text_have_a_bounded_size():
    picture = np.zeros((50, 2000, 3), np.uint8)
    wide = np.array([[0, 20], [2000, 20], [2000, 21], [0, 21]], np.float32)
    tall = np.array([[20, 0], [20.01, 0], [20.01, 50], [20, 50]], np.float32)
    assert upright(picture, wide, 48).shape == (48, 576, 3)
    assert upright(picture, tall, 48).shape == (48, 12, 3)


def likely_at(*texts):
    likely = np.zeros((160, 320), np.float32)
    for (x, y), size, angle, value in texts:
        cv2.fillPoly(likely, [cv2.boxPoints(((x, y), size, angle)).astype(np.int32)], value)
    return likely


def test_a_box_is_grown_around_what_is_marked():
    (corners,) = boxes(likely_at(((100, 50), (60, 10), 0, 0.9)))
    left, top = corners[0]
    assert left < 70
    assert top < 45
    width, height = corners[2] - corners[0]
    assert width == pytest.approx(61 + 2 * 61 * 11 / (2 * 72) * 1.6, abs=3)
    assert height == pytest.approx(11 + 2 * 61 * 11 / (2 * 72) * 1.6, abs=3)


@pytest.mark.parametrize("angle", [-40, -10, 0, 10, 40])
def test_corners_begin_at_the_upper_left_whatever_the_tilt(angle):
    (corners,) = boxes(likely_at(((160, 80), (90, 14), angle, 0.9)))
    along = corners[1] - corners[0]
    assert np.degrees(np.arctan2(along[1], along[0])) == pytest.approx(angle, abs=3)


def test_unlikely_or_tiny_regions_are_not_text():
    assert boxes(likely_at(((100, 50), (60, 10), 0, 0.4))) == []
    assert boxes(likely_at(((100, 50), (1, 1), 0, 0.9))) == []
    assert boxes(np.zeros((32, 32), np.float32)) == []


def test_the_region_of_interest():
    picture = np.arange(100 * 200 * 3, dtype=np.uint32).astype(np.uint8).reshape(100, 200, 3)
    part, origin = Region.parse("0.5 0.1 1 0.6").of(picture)
    assert part.shape == (50, 100, 3)
    assert origin.tolist() == [100, 10]


@pytest.mark.parametrize(
    "text", ["", "0 0 1", "0 0 1 1 1", "0.5 0 0.5 1", "-0.1 0 1 1", "0 0 1 1.1", "a b c d", "nan 0 1 1"]
)
def test_an_invalid_region(text):
    with pytest.raises(ValueError, match="left, top, right and bottom"):
        Region.parse(text)
