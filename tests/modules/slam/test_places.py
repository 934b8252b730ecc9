from __future__ import annotations

import numpy as np
import pytest

from modules.slam.places import Places

RNG = np.random.default_rng(3)
PLACES = [RNG.integers(0, 256, (500, 32), dtype=np.uint8) for _ in range(20)]


def seen_again(descriptors):
    """The same place later: half of its corners, each with 20 bits changed, among as many that are new."""
    rng = np.random.default_rng(4)
    bits = np.unpackbits(descriptors[: len(descriptors) // 2], axis=1)
    for row in bits:
        row[rng.choice(256, 20, replace=False)] ^= 1
    new = rng.integers(0, 256, (len(descriptors) - len(bits), 32), dtype=np.uint8)
    return np.vstack([np.packbits(bits, axis=1), new])


@pytest.fixture
def places():
    known = Places()
    for number, descriptors in enumerate(PLACES):
        known.add(number, descriptors)
    return known


@pytest.mark.parametrize("number", [0, 7, 19])
def test_a_place_is_recognised_by_half_of_its_corners(places, number):
    assert places.alike(seen_again(PLACES[number]), range(20), 3)[0] == number


def test_only_requested_places_are_returned(places):
    assert places.alike(PLACES[5], [1, 2, 99], 3) in ([1, 2], [2, 1])
    assert places.alike(PLACES[5], [], 3) == []


def test_a_place_can_be_forgotten(places):
    places.forget(5)
    assert 5 not in places.alike(PLACES[5], range(20), 20)


def test_a_picture_without_corners_matches_no_place(places):
    assert places.alike(np.empty((0, 32), np.uint8), range(20), 3) == []
