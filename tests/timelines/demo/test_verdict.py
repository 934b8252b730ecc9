"""What a recording proves, from recordings that were made up."""

from __future__ import annotations

import pytest

from timelines.demo.recorder import Recording
from timelines.demo.verdict import at, medians, mismatches, reactions, spans

STARTED = 1000.0


def a_plan(sequence, trigger, shares, *contexts, took=0.002):
    return {
        "sequence": sequence,
        "trigger": STARTED + trigger,
        "time": STARTED + trigger + took,
        "cause": f"cause {sequence}",
        "contexts": list(contexts),
        "tasks": {name: {"share": share} for name, share in shares.items()},
    }


def limits(**steps):
    return {task: [(STARTED + when, value) for when, value in own] for task, own in steps.items()}


def accepted(sequence, when):
    return {"stage": "accepted", "sequence": sequence, "time": STARTED + when}


def a_recording():
    """The robot stands, moves at 5 s and stands again at 9 s."""
    return Recording(
        plans=[
            a_plan(1, 1, {"slam": 0.5, "speech": 0.5}),
            a_plan(2, 5, {"slam": 0.99, "speech": 0.01}, "moving"),
            a_plan(3, 9, {"slam": 0.5, "speech": 0.5}),
        ],
        applied=[accepted(2, 5.010), accepted(2, 5.050), {**accepted(2, 5.001), "stage": "inForce"}, accepted(3, 9.02)],
        limits=limits(
            slam=[(0.0, 0.4), (1.2, 0.5), (5.1, 0.99), (9.1, 0.5)],
            speech=[(0.0, 0.4), (1.1, 0.5), (5.04, 0.01), (9.2, 0.5)],
        ),
    )


def test_reactions_are_timed_from_what_triggered_them():
    first, second, third = reactions(a_recording(), STARTED)
    assert second.at == 5
    assert (second.cause, second.contexts, second.moved) == ("cause 2", ("moving",), {"slam": 0.99, "speech": 0.01})
    assert second.plan_ms == pytest.approx(2)
    assert second.patch_ms == pytest.approx(10), "the first patch that was accepted"
    assert second.cgroup_ms == pytest.approx(100), "all limits are in force"
    assert first.patch_ms is None
    assert third.patch_ms == pytest.approx(20)


def test_a_patch_that_was_accepted_before_the_plan_is_of_another():
    """A step is told with the number of the newest plan, which may have been made while the patch was under way."""
    recording = a_recording()
    recording.applied.insert(0, accepted(2, 4.9))
    assert reactions(recording, STARTED)[1].patch_ms == pytest.approx(10)


def test_a_plan_that_moves_no_share_is_no_reaction():
    recording = a_recording()
    recording.plans.insert(2, a_plan(9, 7, {"slam": 0.99, "speech": 0.01}, "moving", "carrying"))
    assert [reaction.at for reaction in reactions(recording, STARTED)] == [1, 5, 9]


def test_a_limit_that_comes_after_the_next_plan_is_not_this_ones():
    recording = a_recording()
    recording.limits["slam"] = [(STARTED + 1.2, 0.5), (STARTED + 9.5, 0.99)]
    assert reactions(recording, STARTED)[1].cgroup_ms is None


def test_medians_count_only_what_got_there():
    found = medians(reactions(a_recording(), STARTED))
    assert found["sample to plan"] == pytest.approx(2)
    assert found["sample to patch"] == pytest.approx(15)
    assert found["sample to cgroup"] == pytest.approx(200)
    assert medians([]) == {}


def test_a_good_recording_has_no_mismatch():
    assert mismatches(a_recording(), {"moving"}) == []


def test_a_context_that_never_held_is_named():
    assert mismatches(a_recording(), {"moving", "carrying", "docked"}) == [
        "context carrying never held",
        "context docked never held",
    ]


def test_a_plan_that_never_reached_the_kernel_is_named():
    recording = a_recording()
    recording.limits["slam"][2] = (STARTED + 5.1, 0.7)
    assert mismatches(recording, set()) == ["cause 2: slam should have 0.99 cores, its cgroup has 0.7"]
    recording.limits.pop("slam")
    assert "cause 1: slam should have 0.5 cores, its cgroup has None" in mismatches(recording, set())


def test_a_plan_that_stood_too_short_need_not_have_arrived():
    recording = a_recording()
    recording.plans.insert(2, a_plan(9, 8.5, {"slam": 0.2, "speech": 0.8}))
    assert mismatches(recording, set()) == []


def test_shares_that_never_changed_prove_nothing():
    recording = Recording(plans=[a_plan(1, 1, {"slam": 0.5})], limits=limits(slam=[(1.1, 0.5)]))
    assert mismatches(recording, set()) == ["the shares never changed"]
    assert "the shares never changed" in mismatches(Recording(), set())


def test_spans_of_one_context_are_joined():
    recording = a_recording()
    recording.plans.insert(2, a_plan(9, 7, {"slam": 0.9, "speech": 0.1}, "moving"))
    assert spans(recording, STARTED) == [("moving", 5, 9)]


def test_spans_with_a_pause_stay_apart():
    plans = [a_plan(n, n, {"slam": 0.5}, *names) for n, names in ((1, ["a"]), (2, []), (3, ["a", "b"]), (4, []))]
    assert spans(Recording(plans=plans), STARTED) == [("a", 1, 2), ("a", 3, 4), ("b", 3, 4)]


def test_the_value_at_a_moment():
    steps = [(1.0, 0.5), (2.0, 0.9)]
    assert [at(steps, moment) for moment in (0.5, 1.0, 1.9, 2.0, 9.0)] == [None, 0.5, 0.5, 0.9, 0.9]


def test_what_a_recording_knows_last():
    recording = Recording(
        limits={"slam": [(1.0, 0.5), (2.0, 0.9)]}, usage={"slam": [(1.0, 0.2), (1.5, 0.6), (2.0, 0.8)]}
    )
    assert recording.limit("slam") == 0.9
    assert recording.limit("speech") is None
    assert recording.cores_used("slam") == pytest.approx(0.4)
    assert recording.cores_used("speech") == 0.0
