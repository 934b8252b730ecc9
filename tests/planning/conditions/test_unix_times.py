"""Times of today: at 1.8e9 seconds a float steps by 0.24 us, and sums of it are rounded."""

import pytest

from contextpolicy.planning.conditions.absence import UNHEARD
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.planner import Planner
from tests.planning.builders import a_context, a_policy, a_stream, a_task, on_node
from tests.planning.quiet import Quiet

TODAY = 1795254707.0


@pytest.mark.parametrize("decay", ["1s", "300ms", "7s", "1ms", "1m"])
@pytest.mark.parametrize("offset", [0.0, 0.1, 0.289, 0.3333333, 0.9999999])
def test_decay_comes_to_an_end(decay, offset):
    """A step that was computed from the rounded clock once set its timer to the present, for ever."""
    activity = {"when": "mic.level > 0.1", "hold": "300ms", "decay": decay}
    policy = a_policy(streams=[a_stream("mic")], tasks=[a_task("speech", activity=[activity]), a_task("slam")])
    planner, now = Planner(policy, Quiet(), {}), TODAY + offset
    planner.start(now)
    planner.handle(on_node("speech", "slam"), now)
    planner.handle(Sample("mic", {"level": 0.5}), now)
    instants = 0
    while (due := planner.next_due()) is not None and due < now + UNHEARD - 1:
        planner.advance(due)
        instants += 1
        assert instants <= 10
    assert planner.scores()["speech"] == 0.0
    assert instants == 10


PERIODS = [0.1, 0.3, 0.333, 0.7]


def every(period, count=200):
    """Moments of a steady sensor, each rounded as a clock's would be."""
    return [TODAY + number * period for number in range(1, count)]


@pytest.mark.parametrize("period", PERIODS)
def test_a_period_equal_to_hold_does_not_flap(period):
    activity = {"when": "mic.level > 0.1", "hold": f"{period}s"}
    policy = a_policy(streams=[a_stream("mic")], tasks=[a_task("speech", activity=[activity]), a_task("slam")])
    assert contexts_and_scores(policy, period)[0] == {1.0}


@pytest.mark.parametrize("period", PERIODS)
def test_a_period_equal_to_stale_after_is_not_silence(period):
    streams = [a_stream("mic", staleAfter=f"{period}s")]
    contexts = [a_context("on", "mic.level > 0.1"), a_context("blind")]
    policy = a_policy(streams=streams, tasks=[a_task("speech")], contexts=contexts, fallback="blind")
    assert contexts_and_scores(policy, period)[1] == {("on",)}


@pytest.mark.parametrize("period", PERIODS)
def test_a_period_equal_to_the_window_keeps_one_sample_in_it(period):
    streams = [a_stream("mic", features=[{"name": "n", "op": "count", "over": f"{period}s"}])]
    policy = a_policy(streams=streams, tasks=[a_task("speech")], contexts=[a_context("on", "mic.n == 1")])
    assert contexts_and_scores(policy, period)[1] == {("on",)}


@pytest.mark.parametrize("period", PERIODS)
def test_a_period_equal_to_an_age_does_not_flap(period):
    contexts = [a_context("old", f"age(mic) >= {period}"), a_context("on", f"age(mic) < {period}")]
    policy = a_policy(streams=[a_stream("mic")], tasks=[a_task("speech")], contexts=contexts)
    assert contexts_and_scores(policy, period)[1] == {("on",)}


@pytest.mark.parametrize("period", PERIODS)
def test_a_period_equal_to_sample_every_passes_each_sample_at_once(period):
    streams = [a_stream("mic", sampleEvery=f"{period}s")]
    policy = a_policy(streams=streams, tasks=[a_task("speech", activity=[{"scoreFrom": "mic.number"}])])
    planner = Planner(policy, Quiet(), {})
    planner.start(TODAY)
    for number, now in enumerate(every(period), start=1):
        planner.handle(Sample("mic", {"number": number}), now)
        assert planner.scores()["speech"] == number


class Listening(Planner):
    """It keeps every score that it heard of."""

    def __init__(self, policy):
        self.heard: set[float] = set()
        super().__init__(policy, Quiet(), {})

    def on_score(self, initiative, now):
        super().on_score(initiative, now)
        self.heard.add(initiative.value)


def contexts_and_scores(policy, period):
    """All that a steady sensor makes of speech's score and of the contexts after its first sample."""
    planner = Listening(policy)
    planner.start(TODAY)
    first, *others = every(period)
    planner.handle(Sample("mic", {"level": 0.5}), first)
    planner.heard.clear()
    scores, contexts = planner.heard, set()
    for now in others:
        plans = planner.handle(Sample("mic", {"level": 0.5}), now)
        scores.add(planner.scores()["speech"])
        assert planner.last is not None
        contexts |= {plan.contexts for plan in [*plans, planner.last]}
    return scores, contexts
