"""The networks see the right stretch, keep their weights, and weigh the spotter's score."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.phones import PHONES
from modules.speech.spotter import KEYWORDS, Mark
from modules.speech.verifier import COLUMNS, INPUTS, WEIGHTS, Network, Verifier, views


def phone(number, start, end, frames=200):
    """Posteriors in which one phone sounds from one frame to another, and nothing is known elsewhere."""
    posteriors = np.zeros((frames, PHONES), np.float32)
    posteriors[start:end, number] = 1
    return posteriors


def test_the_second_around_the_mark_is_seen_in_its_own_time():
    second, _ = views(phone(7, 100, 112), 0.98, 1.14)
    columns = second.reshape(COLUMNS, PHONES)[:, 7]
    assert np.flatnonzero(columns > 0.9).tolist() == [11, 12, 13]


def test_a_slow_word_looks_like_a_fast_one():
    fast = views(phone(7, 100, 140), 1.0, 1.4)[1]
    slow = views(phone(7, 60, 140), 0.6, 1.4)[1]
    assert slow == pytest.approx(fast, abs=0.02)


def test_beyond_the_ends_nothing_sounds():
    for seen in views(phone(7, 0, 10, frames=10), -3, -2.5):
        assert not seen.any()
    assert views(np.zeros((0, PHONES), np.float32), 0, 0.3)[0].shape == (INPUTS,)


def test_weights_are_kept(tmp_path):
    rng = np.random.default_rng(1)
    network = Network(((rng.normal(size=(INPUTS, 2)).astype(np.float32), np.ones(2, np.float32)),))
    Verifier(("other", "left"), ((network,), (network, network))).save(tmp_path / "weights.npz")
    loaded = Verifier.load(tmp_path / "weights.npz")
    assert loaded.labels == ("other", "left")
    assert [len(committee) for committee in loaded.committees] == [1, 2]
    seen = rng.random((3, INPUTS)).astype(np.float32)
    for one in (*loaded.committees[0], *loaded.committees[1]):
        assert one.log_probabilities(seen) == pytest.approx(network.log_probabilities(seen), abs=0.05)


def test_probabilities_sum_to_one():
    network = Verifier.load().committees[0][0]
    seen = np.random.default_rng(1).random((3, INPUTS)).astype(np.float32)
    assert np.exp(network.log_probabilities(seen)).sum(axis=1) == pytest.approx(np.ones(3), abs=1e-5)


def test_the_shipped_weights_are_for_the_spotters_keywords_and_small():
    assert Verifier.load().labels == ("other", *KEYWORDS)
    assert WEIGHTS.stat().st_size < 2_000_000


def test_a_surer_spotter_is_more_evidence():
    verifier = Verifier.load()
    posteriors = phone(7, 100, 112)
    weak, strong = (verifier.evidence(posteriors, Mark("left", 1.0, 1.3, score)) for score in (-0.2, -0.1))
    assert strong - weak == pytest.approx(3)
