"""The whole way from an encoded picture to a sign, with the real networks."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from modules.signs.detector import Detector, Region
from modules.signs.digits import Digits
from modules.signs.networks import find
from modules.signs.paddle import Paddle
from modules.signs.rendering import TEST_FONTS, Conditions, render
from modules.signs.task import LARGEST, SMALLEST, Signs
from modules.signs.watcher import Watcher
from robotkit import MessageError, Received, stereo

SECOND = 10**9
START = 1_700_000_000 * SECOND
SIZE = (752, 480)


@pytest.fixture(scope="module")
def networks():
    cv2.setNumThreads(1)
    return find("")


@pytest.fixture(scope="module")
def paddle(networks):
    return Paddle(*networks.recognition())


@pytest.fixture
def detector(networks):
    return Detector(networks.detection(), side=416)


@pytest.fixture
def task(detector, paddle):
    return Signs(Watcher(detector, paddle))


def sign(text="214", middle=(300, 200), seed=6, **conditions):
    return render(
        text,
        TEST_FONTS[1],
        Conditions(**{"height": 32, "tilt": 15, **conditions}),
        np.random.default_rng(seed),
        size=SIZE,
        middle=middle,
    ).picture


def received(picture, number=0, encoding="jpeg"):
    payload = cv2.imencode(".png", picture)[1].tobytes()
    if encoding == "stereo-frame":
        payload = stereo.encode(stereo.StereoFrame(1, payload, b""))
    return Received(payload, START + number * SECOND // 2, 0, "picture", encoding)


def test_a_sign_is_reported_once_with_where_and_when_it_was_read_best(task):
    results = [task.process(received(sign(middle=(300 + 4 * i, 200)), i)) for i in range(4)]
    (reported,) = [result for one in results for result in one]
    assert (reported.output, reported.value["text"]) == ("sign", "214")
    assert reported.value["confidence"] > 0.9
    assert reported.stamp in {START, START + SECOND // 2}
    (left, top), _, (right, bottom), _ = reported.value["corners"]
    assert left < 300 < right
    assert top < 200 < bottom


def test_the_left_picture_of_a_pair_will_do(task):
    results = [task.process(received(sign(), i, "stereo-frame")) for i in range(2)]
    assert [result.value["text"] for one in results for result in one] == ["214"]


def test_letters_are_read_too(task):
    results = [task.process(received(sign("B12"), i)) for i in range(2)]
    assert [result.value["text"] for one in results for result in one] == ["B12"]


def test_a_sign_outside_of_the_region_is_not_seen(networks, paddle):
    watcher = Watcher(Detector(networks.detection(), Region.parse("0 0.6 1 1"), side=416), paddle)
    assert [watcher.watch(sign(), START + i * SECOND) for i in range(3)] == [[], [], []]


def test_a_number_that_the_edge_cuts_is_not_read(detector):
    assert detector.find(sign("2143", middle=(0, 200), height=50, seed=5)) == []


def test_corners_do_not_depend_on_the_size_that_is_looked_at(detector):
    (coarse,) = detector.find(sign())
    detector.side = 736
    (fine,) = detector.find(sign())
    assert np.abs(coarse - fine).max() < 20


def test_a_static_scene_is_rarely_searched_again(task, detector, monkeypatch):
    picture, find, looks = sign(), detector.find, 0

    def look(seen):
        nonlocal looks
        looks += 1
        return find(seen)

    monkeypatch.setattr(detector, "find", look)
    for index in range(20):  # ten seconds
        task.process(received(picture, index))
    assert looks == 3  # twice until the sign is reported, once more after five seconds


@pytest.mark.parametrize(("quality", "side"), [(1.0, LARGEST), (0.5, 520), (0.1, SMALLEST)])
def test_quality_sets_the_detector_resolution(task, detector, quality, side):
    task.set_quality(quality)
    assert detector.side == side


@pytest.mark.parametrize("payload", [b"", b"garbage"])
def test_a_broken_picture_is_refused(task, payload):
    with pytest.raises(MessageError):
        task.process(Received(payload, START, 0, "picture", "jpeg"))


@pytest.mark.parametrize("size", [(1, 1), (5, 400), (2000, 10)])
def test_pictures_of_odd_sizes(task, size):
    assert task.process(received(np.zeros((size[1], size[0], 3), np.uint8))) == []


def test_the_paper_s_way_reads_digits(detector):
    watcher = Watcher(detector, Digits())
    reported = [one for i in range(2) for one in watcher.watch(sign(tilt=0, seed=7), START + i * SECOND)]
    assert [one.text for one in reported] == ["214"]
