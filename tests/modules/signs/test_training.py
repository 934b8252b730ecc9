"""The training, on a handful of signs: what it draws, what it labels, and that OpenCV runs what it writes."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from modules.signs import examples, training
from modules.signs.boxes import around
from modules.signs.digits import HEIGHT, LABELS, NONE, STRIDE, Digits, strip
from modules.signs.reading import upright
from modules.signs.rendering import TEST_FONTS, Conditions, any_conditions, any_number, quad, render


@pytest.fixture
def sign():
    return render("407", TEST_FONTS[0], Conditions(height=40), np.random.default_rng(3))


def test_boxes_are_where_the_ink_is(sign):
    gray = sign.picture.astype(float).mean(axis=2)
    for box in sign.boxes:
        rows, columns = (
            slice(round(box.top), round(box.top + box.height)),
            slice(round(box.left), round(box.left + box.width)),
        )
        assert np.ptp(gray[rows, columns]) > 30
    assert sign.text == "407"


def test_every_digit_has_its_columns_and_gaps_have_none(sign):
    corners = quad(sign, 0.2, 0.1).astype(np.float32)
    columns = strip(upright(sign.picture, corners, HEIGHT)).shape[1] // STRIDE
    labels = examples.column_labels(sign, corners, columns)
    reported = [int(label) for label in labels if label >= 0]
    runs = [label for index, label in enumerate(reported) if index == 0 or reported[index - 1] != label]
    assert runs == [NONE, 4, NONE, 0, NONE, 7, NONE]


def test_the_strip_has_the_same_contrast_in_any_light(sign):
    dark = (sign.picture // 4).astype(np.uint8)
    corners = around(sign.boxes, 0.1, 0.1)
    bright, dim = (strip(upright(picture, corners, HEIGHT)) for picture in (sign.picture, dark))
    assert bright.shape[0] == HEIGHT
    assert bright.std() == pytest.approx(1, abs=0.01)
    assert np.abs(bright - dim).mean() < 0.1


def test_saved_network_gives_the_trained_probabilities(tmp_path):
    parameters = [(np.asarray(weights), np.asarray(bias)) for weights, bias in training.initial(1)]
    training.save(parameters, tmp_path / "digits.onnx")
    seen = np.random.default_rng(1).normal(0, 1, (HEIGHT, 64)).astype(np.float32)
    reported = Digits(tmp_path / "digits.onnx").columns(seen)
    scores = np.asarray(training.scores(parameters, jnp.asarray(seen[None])))[0]
    likely = np.exp(scores - scores.max(axis=1, keepdims=True))
    assert reported.shape == (64 // STRIDE, len(LABELS) + 1)
    assert np.allclose(reported, likely / likely.sum(axis=1, keepdims=True), atol=1e-4)


def test_training_reduces_the_loss(monkeypatch):
    monkeypatch.setattr(examples, "fonts", lambda: list(TEST_FONTS))
    drawn: list[int] = []
    seen = examples.examples(64, 1, drawn.append)
    assert drawn == [64]
    kept = np.ones((1, 1, 1, 64), np.float32)
    before, after = training.initial(1), training.train(seen, epochs=4)
    assert training.loss(after, seen.strips, seen.labels, kept) < 0.9 * training.loss(
        before, seen.strips, seen.labels, kept
    )


def test_missing_fonts_are_reported(monkeypatch):
    monkeypatch.setattr(examples, "fonts", list)
    with pytest.raises(SystemExit, match="liberation"):
        examples.examples(1, 1, lambda _: None)


def test_numbers_have_one_to_five_digits_and_no_leading_zero():
    rng = np.random.default_rng(1)
    drawn = [any_number(rng) for _ in range(300)]
    assert {len(text) for text in drawn} == {1, 2, 3, 4, 5}
    assert not any(text.startswith("0") for text in drawn)
    assert all(9 <= any_conditions(rng).height <= 60 for _ in range(100))
