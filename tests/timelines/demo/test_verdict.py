"""What a recording proves, on made-up recordings."""

from __future__ import annotations

import pytest

from timelines.demo.recorder import Recording
from timelines.demo.verdict import Conversion, at, medians, mismatches, patches, reactions, spans

STARTED = 1000.0
LIMITED, AGENT = Conversion(1), Conversion(1, beside={"slam": 100})


def a_plan(sequence, trigger, shares, *contexts, took=0.002, weights=None):
    """Under Limit each share is a quota; with `weights`, in cores, a share below 0.02 is."""
    return {
        "targets": [
            {
                "task": name,
                "cores": share,
                "weight": None if weights is None else weights[name],
                "quota": share if weights is None or share < 0.02 else 1.0,
            }
            for name, share in shares.items()
        ],
        "sequence": sequence,
        "trigger": STARTED + trigger,
        "time": STARTED + trigger + took,
        "cause": f"cause {sequence}",
        "contexts": list(contexts),
        "tasks": {name: {"share": share} for name, share in shares.items()},
    }


def limits(**steps):
    return {task: [(STARTED + when, value) for when, value in own] for task, own in steps.items()}


def under_weights():
    """The robot moves at 5 s: speech is suspended, slam weighs all the more, beside a guard that requests 100m."""
    return Recording(
        plans=[
            a_plan(1, 1, {"slam": 0.5, "speech": 0.5}, weights={"slam": 0.5, "speech": 0.5}),
            a_plan(2, 5, {"slam": 0.99, "speech": 0.01}, "moving", weights={"slam": 0.99, "speech": 0}),
        ],
        weights=limits(slam=[(1.1, 614), (5.01, 1116)], speech=[(1.1, 512), (5.02, 2)]),
        limits=limits(slam=[(0.0, 1.0)], speech=[(0.0, 1.0), (5.5, 0.01)]),
        patched=limits(slam=[(0.0, 1.0)], speech=[(0.0, 1.0), (7.5, 0.01)]),
    )


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
        patched=limits(
            slam=[(0.0, 0.4), (1.1, 0.5), (5.1, 0.99), (9.1, 0.5)], speech=[(1.1, 0.5), (5.1, 0.01), (9.1, 0.5)]
        ),
    )


def test_reactions_are_timed_from_what_triggered_them():
    first, second, third = reactions(a_recording(), STARTED, LIMITED)
    assert second.at == 5
    assert (second.cause, second.contexts, second.moved) == ("cause 2", ("moving",), {"slam": 0.99, "speech": 0.01})
    assert second.plan_ms == pytest.approx(2)
    assert second.patch_ms == pytest.approx(10), "the first patch that was accepted"
    assert second.cgroup_ms == pytest.approx(100), "all limits are in force"
    assert first.patch_ms is None
    assert third.patch_ms == pytest.approx(20)


def test_a_patch_accepted_before_the_plan_is_ignored():
    """A step is shown with the number of the newest plan, which may have been made while the patch was under way."""
    recording = a_recording()
    recording.applied.insert(0, accepted(2, 4.9))
    assert reactions(recording, STARTED, LIMITED)[1].patch_ms == pytest.approx(10)


def test_a_plan_that_moves_no_share_is_not_a_reaction():
    recording = a_recording()
    recording.plans.insert(2, a_plan(9, 7, {"slam": 0.99, "speech": 0.01}, "moving", "carrying"))
    assert [reaction.at for reaction in reactions(recording, STARTED, LIMITED)] == [1, 5, 9]


def test_a_limit_after_the_next_plan_is_ignored():
    recording = a_recording()
    recording.limits["slam"] = [(STARTED + 1.2, 0.5), (STARTED + 9.5, 0.99)]
    assert reactions(recording, STARTED, LIMITED)[1].cgroup_ms is None


def test_medians_ignore_reactions_that_never_arrived():
    found = medians(reactions(a_recording(), STARTED, LIMITED))
    assert found["sample to plan"] == pytest.approx(2)
    assert found["sample to patch"] == pytest.approx(15)
    assert found["sample to cgroup"] == pytest.approx(200)
    assert medians([]) == {}


def test_a_good_recording_has_no_mismatch():
    assert mismatches(a_recording(), {"moving"}, LIMITED) == []


def test_a_context_that_never_held_is_named():
    assert mismatches(a_recording(), {"moving", "carrying", "docked"}, LIMITED) == [
        "context carrying never held",
        "context docked never held",
    ]


def test_a_plan_that_never_reached_the_kernel_is_named():
    recording = a_recording()
    recording.limits["slam"][2] = (STARTED + 5.1, 0.7)
    assert mismatches(recording, set(), LIMITED) == [
        "cause 2: slam should have a quota of 0.99 cores, its cgroup has 0.7"
    ]
    recording.limits.pop("slam")
    assert "cause 1: slam should have a quota of 0.5 cores, its cgroup has None" in mismatches(
        recording, set(), LIMITED
    )


def test_a_short_lived_plan_need_not_reach_the_kernel():
    recording = a_recording()
    recording.plans.insert(2, a_plan(9, 8.5, {"slam": 0.2, "speech": 0.8}))
    assert mismatches(recording, set(), LIMITED) == []


def test_shares_that_never_changed_are_a_mismatch():
    recording = Recording(
        plans=[a_plan(1, 1, {"slam": 0.5})], limits=limits(slam=[(1.1, 0.5)]), patched=limits(slam=[(1.1, 0.5)])
    )
    assert mismatches(recording, set(), LIMITED) == ["the shares never changed"]
    assert "the shares never changed" in mismatches(Recording(), set(), LIMITED)


def test_spans_of_one_context_are_joined():
    recording = a_recording()
    recording.plans.insert(2, a_plan(9, 7, {"slam": 0.9, "speech": 0.1}, "moving"))
    assert spans(recording, STARTED) == [("moving", 5, 9)]


def test_spans_with_a_pause_stay_apart():
    plans = [a_plan(n, n, {"slam": 0.5}, *names) for n, names in ((1, ["a"]), (2, []), (3, ["a", "b"]), (4, []))]
    assert spans(Recording(plans=plans), STARTED) == [("a", 1, 2), ("a", 3, 4), ("b", 3, 4)]


def test_value_of_a_step_function_at_a_time():
    steps = [(1.0, 0.5), (2.0, 0.9)]
    assert [at(steps, moment) for moment in (0.5, 1.0, 1.9, 2.0, 9.0)] == [None, 0.5, 0.5, 0.9, 0.9]


def test_last_limit_and_usage_of_a_recording():
    recording = Recording(
        limits={"slam": [(1.0, 0.5), (2.0, 0.9)]}, usage={"slam": [(1.0, 0.2), (1.5, 0.6), (2.0, 0.8)]}
    )
    assert recording.limit("slam") == 0.9
    assert recording.limit("speech") is None
    assert recording.cores_used("slam") == pytest.approx(0.4)
    assert recording.cores_used("speech") == 0.0


def test_weights_are_those_of_pods_with_what_the_other_containers_request():
    assert mismatches(under_weights(), {"moving"}, AGENT) == []
    first, second = reactions(under_weights(), STARTED, AGENT)
    assert [first.cgroup_ms, second.cgroup_ms] == pytest.approx([100, 20])


def test_a_weight_that_never_reached_the_kernel_is_named():
    recording = under_weights()
    recording.weights["slam"].pop()
    assert mismatches(recording, set(), AGENT) == ["cause 2: slam should weigh 1116, its pod's cgroup has 614"]


def test_without_an_agent_weights_are_scaled_to_requests():
    half = Conversion(1, factor=0.5, beside={"slam": 100})
    recording = under_weights()
    recording.weights = limits(slam=[(1.1, 358), (5.1, 609)], speech=[(1.1, 256), (5.1, 2)])
    assert mismatches(recording, set(), half) == []


def test_requests_are_made_of_the_weights_before_they_are_cut_for_an_agent():
    """A protected task weighs a core there, however little it needs."""
    recording = under_weights()
    for plan in recording.plans:
        for target in plan["targets"]:
            target["weight"] /= 2
    recording.weights = limits(slam=[(1.1, 512)], speech=[(1.1, 256), (5.1, 2)])
    assert mismatches(recording, set(), Conversion(1, factor=0.5, protected={"slam"})) == []
    assert mismatches(recording, set(), Conversion(1, factor=0.5)) != []


def test_a_suspension_that_lasts_and_never_reached_the_api_is_named():
    recording = under_weights()
    recording.patched["speech"].pop()
    assert mismatches(recording, set(), AGENT) == ["cause 2: speech should have a limit of 0.01 cores, the API has 1.0"]
    recording.plans.append(a_plan(3, 8.5, {"slam": 0.5, "speech": 0.5}, weights={"slam": 0.5, "speech": 0.5}))
    recording.weights = limits(slam=[(1.1, 614), (5.01, 1116), (8.6, 614)], speech=[(1.1, 512), (5.02, 2), (8.6, 512)])
    recording.limits["speech"].append((STARTED + 8.6, 1.0))
    assert mismatches(recording, set(), AGENT) == []


def test_patched_limits_are_listed_in_order():
    assert patches(under_weights(), STARTED) == [(7.5, "speech", 1.0, 0.01)]
    assert patches(under_weights(), STARTED + 8) == []


def test_a_last_plan_shorter_than_a_second_is_not_compared():
    recording = under_weights()
    recording.plans.append(a_plan(3, 9, {"slam": 0.5, "speech": 0.5}, weights={"slam": 0.5, "speech": 0.5}))
    assert mismatches(recording, set(), AGENT) != []
    recording.ended = STARTED + 9.9
    assert mismatches(recording, set(), AGENT) == []


def test_a_weight_that_the_kubelet_has_just_overwritten_counts_as_in_force():
    recording = under_weights()
    recording.plans.append(a_plan(3, 9, {"slam": 0.99, "speech": 0.5}, weights={"slam": 0.99, "speech": 0.5}))
    recording.weights["speech"] += [(STARTED + 8.9, 10), (STARTED + 9.05, 512)]
    recording.limits["speech"].append((STARTED + 9.05, 1.0))
    recording.patched["speech"].append((STARTED + 11.5, 1.0))
    assert mismatches(recording, set(), AGENT) == []
    recording.weights["speech"].insert(-2, (STARTED + 7, 10))
    assert mismatches(recording, set(), AGENT) == ["cause 2: speech should weigh 2, its pod's cgroup has 10"]
