"""The patrol robot's policy means what it reads like, on whatever its sensors send."""

from __future__ import annotations

from pathlib import Path

import ormsgpack
import pytest

from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.planner import Planner
from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.streams.decoding import Decoder
from tests.planning.builders import START, on_node
from tests.planning.quiet import Quiet

POLICY = load_policy(str(Path(__file__).parents[2] / "config/policies/patrol-robot.yaml"))


@pytest.fixture
def planner():
    planner = Planner(POLICY, Quiet(), {})
    planner.start(START)
    planner.handle(on_node(*(task.name for task in POLICY.leaves), cores=4), START)
    return planner


@pytest.mark.parametrize(("nearest", "score"), [(4, 1.0), (4.0, 1.0), (2, 2.0), (1, 2.0), (8.0, 0.5), (5, 0.8)])
def test_a_person_scores_by_distance_however_it_is_spelled(planner, nearest, score):
    decoder = Decoder(next(stream for stream in POLICY.streams if stream.name == "people"))
    planner.handle(decoder.decode(ormsgpack.packb({"count": 1, "nearest": nearest})), START + 1)
    assert planner.scores()["people"] == score
    assert planner.errors == {}


def test_or_decides_with_one_unheard_stream(planner):
    planner.handle(Sample("mic", {"level": 0.9}), START + 1)
    assert "alarm" in [context.spec.name for context in planner.active_contexts()]
