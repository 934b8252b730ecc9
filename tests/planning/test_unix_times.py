"""Times of today: at 1.8e9 seconds a float steps by 0.24 us, and sums of it are rounded."""

import pytest

from contextpolicy.planning.planner import Planner
from contextpolicy.planning.sample import Sample
from tests.planning.builders import a_policy, a_stream, a_task, on_node

TODAY = 1795254707.0


@pytest.mark.parametrize("decay", ["1s", "300ms", "7s", "1ms", "1m"])
@pytest.mark.parametrize("offset", [0.0, 0.1, 0.289, 0.3333333, 0.9999999])
def test_decay_comes_to_an_end(decay, offset):
    """A step that was computed from the rounded clock once set its timer to the present, for ever."""
    activity = {"when": "mic.level > 0.1", "hold": "300ms", "decay": decay}
    policy = a_policy(streams=[a_stream("mic")], tasks=[a_task("speech", activity=[activity]), a_task("slam")])
    planner, now = Planner(policy), TODAY + offset
    planner.start(now)
    planner.handle(on_node("speech", "slam"), now)
    planner.handle(Sample("mic", {"level": 0.5}), now)
    instants = 0
    while (due := planner.next_due()) is not None:
        planner.advance(due)
        instants += 1
        assert instants <= 10
    assert planner.scores()["speech"] == 0.0
    assert instants == 10
