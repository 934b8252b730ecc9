"""Where the networks are taught to look, and what is there."""

from __future__ import annotations

import numpy as np
import pytest

from modules.speech.corpus import Spoken
from modules.speech.examples import LABELS, examine
from modules.speech.spotter import KEYWORDS
from tests.modules.sounds import needs_voices

pytestmark = needs_voices


@pytest.fixture(scope="module")
def examples():
    texts: list[Spoken | None] = [Spoken(word, word, "rms", 1, 1) for word in KEYWORDS]
    texts += [Spoken("write about the light on the right hand shelf", None, "slt", 1.1, 0.9), None]
    done: list[int] = []
    found = examine(texts, 1, done.append)
    assert done == [len(texts)]
    return found


def test_each_command_is_seen_twice_in_each_of_three_rooms(examples):
    assert np.bincount(examples.labels, minlength=len(LABELS))[1:].tolist() == [6] * len(KEYWORDS)
    assert examples.marked[examples.labels > 0].all()


def test_other_speech_is_seen_where_it_is_marked_and_elsewhere(examples):
    others = examples.marked[examples.labels == 0]
    assert others.any()
    assert not others.all()


def test_the_same_seed_gives_the_same_examples(examples):
    texts: list[Spoken | None] = [Spoken(word, word, "rms", 1, 1) for word in KEYWORDS]
    once, again = (examine(texts, 1, lambda _: None) for _ in range(2))
    assert all(np.array_equal(mine, its) for mine, its in zip(once.views, again.views, strict=True))
    assert not np.array_equal(once.views[0][:6], examine(texts, 2, lambda _: None).views[0][:6])
    assert examples.views[0].shape[1] == once.views[0].shape[1]
