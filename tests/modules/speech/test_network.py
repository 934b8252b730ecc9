"""The networks decide by a second of sound, keep their weights, and are small."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.keywords import KEYWORDS
from modules.speech.network import WEIGHTS, Committee, Layer, Network
from modules.speech.windows import SEEN, WIDTH


@pytest.fixture
def windows():
    return np.random.default_rng(1).random((3, WIDTH, SEEN)).astype(np.float32)


def network(seed):
    rng = np.random.default_rng(seed)
    first = Layer(rng.normal(0, 0.1, (5, SEEN, 4)).astype(np.float32), np.zeros(4, np.float32), 2)
    return Network((first, Layer(rng.normal(size=(23, 4, 2)).astype(np.float32), np.ones(2, np.float32), 1)))


def test_a_layer_is_a_convolution_along_time():
    values = np.arange(6, dtype=np.float32).reshape(1, 6, 1)
    layer = Layer(np.array([[[1]], [[10]]], np.float32), np.array([0.5], np.float32), 2)
    assert layer(values).ravel().tolist() == [10.5, 32.5, 54.5]


def test_probabilities_sum_to_one(windows):
    assert np.exp(network(1).log_probabilities(windows)).sum(axis=1) == pytest.approx(np.ones(3), abs=1e-5)


def test_evidence_is_the_log_odds_of_the_averaged_networks(windows):
    networks = network(1), network(2)
    mean = np.exp(np.mean([one.log_probabilities(windows) for one in networks], axis=0))
    likely = mean[:, 1] / mean.sum(axis=1)
    evidence = Committee(("other", "left"), networks).evidence(windows)
    assert evidence[:, 0] == pytest.approx(np.log(likely / (1 - likely)), abs=1e-3)


def test_saved_weights_can_be_loaded(tmp_path, windows):
    Committee(("other", "left"), (network(1), network(2))).save(tmp_path / "weights.npz")
    loaded = Committee.load(tmp_path / "weights.npz")
    assert loaded.labels == ("other", "left")
    for one, seed in zip(loaded.networks, (1, 2), strict=True):
        assert one.log_probabilities(windows) == pytest.approx(network(seed).log_probabilities(windows), abs=0.05)


def test_the_shipped_weights_are_for_the_commands_and_small(windows):
    committee = Committee.load()
    assert committee.labels == ("other", *KEYWORDS)
    assert committee.evidence(windows).shape == (3, len(KEYWORDS))
    assert WEIGHTS.stat().st_size < 1_000_000
