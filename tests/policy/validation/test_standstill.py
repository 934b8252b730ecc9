"""Contexts that stop what another one waits for, and conditions on streams that are known to be stopped."""

from __future__ import annotations

import pytest

from contextpolicy.policy.validation.advice import advice
from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task

MIC = a_stream("mic", producedBy="speech")
STALE = {**MIC, "staleAfter": "1s"}
QUIET = {"speech": {"suspend": True}}
OTHER = {"slam": {"weight": 2}}


def a_robot(*contexts, mic=MIC, slam=()):
    tasks = [a_task("speech"), a_task("slam", **dict(slam)), a_task("rest")]
    own = [{"exitAfter": "1ms", **one} for one in contexts]
    return a_policy(streams=[a_stream("imu"), mic], tasks=tasks, contexts=own)


def reported(policy):
    return [one.allowed for one in advice(policy)]


def run_story(policy, *, until=20):
    """Speech publishes a loud level each second while it is not suspended; the imu turns once and back."""
    story = Story(policy)
    for at in range(until):
        story.sample("imu", at=at, x=2.0 if 2 <= at < 10 else 0.0)
        if not story.last.tasks["speech"].suspended:
            story.sample("mic", at=at + 0.5, level=0.1 if at < 4 else 0.9)
    story.wait(until)
    return story


@pytest.mark.parametrize("mic", [MIC, STALE])
def test_a_context_may_latch_through_one_that_reads_it(mic):
    wary = a_context("wary", "imu.x > 1", OTHER, until="mic.level > 0.3")
    policy = a_robot(wary, a_context("quiet", "contexts.wary", QUIET), mic=mic)
    assert reported(policy) == [
        (
            "context wary, beside which quiet holds, suspends speech, which produces mic: "
            "nothing else ends it, so once begun it holds for ever"
        )
    ]
    assert run_story(policy).last.contexts == ("wary", "quiet")


@pytest.mark.parametrize("delay", ["0s", "1s"])
def test_a_context_may_latch_through_several(delay):
    wary = a_context("wary", "imu.x > 1", OTHER, until="mic.level > 0.3")
    calm = a_context("calm", "contexts.wary", {"rest": {"weight": 2}}, enterAfter=delay)
    policy = a_robot(wary, calm, a_context("quiet", "contexts.calm", QUIET))
    (one,) = reported(policy)
    assert one.startswith("context wary, beside which quiet holds, suspends speech, which produces mic: ")
    assert run_story(policy).last.contexts == ("wary", "calm", "quiet")


def test_no_latch_if_a_context_between_may_never_begin():
    wary = a_context("wary", "imu.x > 1", OTHER, until="mic.level > 0.3")
    calm = a_context("calm", "contexts.wary && imu.x < 2", OTHER, enterAfter="1s")
    policy = a_robot(wary, calm, a_context("quiet", "contexts.calm", QUIET))
    assert reported(policy) == []
    assert run_story(policy).last.contexts == ()


@pytest.mark.parametrize("quiet", ["contexts.wary && imu.x > 1", "imu.x > 1", "contexts.other"])
def test_no_latch_if_the_other_context_may_end_first(quiet):
    wary = a_context("wary", "imu.x > 1", OTHER, until="mic.level > 0.3")
    other = a_context("other", "imu.x > 1", OTHER)
    policy = a_robot(wary, other, a_context("quiet", quiet, QUIET))
    assert reported(policy) == []
    assert run_story(policy).last.contexts == ()


def test_it_is_reported_once():
    loud = a_context("loud", "mic.level > 0.3", OTHER)
    (one,) = [one for one in reported(a_robot(loud, a_context("quiet", "contexts.loud", QUIET))) if "for ever" in one]
    assert one.startswith("context quiet suspends speech")


ASKS = [{"when": "mic.level > 0.05"}]
TURNED = a_context("quiet", "imu.x > 1", QUIET)


def frozen(policy):
    return [one for one in reported(policy) if "on its last sample" in one]


def test_a_last_value_meets_a_pre_condition_while_its_producer_is_suspended():
    policy = a_robot(TURNED, slam={"requires": ASKS})
    (one,) = frozen(policy)
    assert one.startswith("context quiet suspends speech, which produces mic: without staleAfter slam keeps running on")
    during = [plan for plan in run_story(policy).plans if plan.contexts]
    assert {plan.tasks["slam"].suspended for plan in during} == {False}


@pytest.mark.parametrize(
    ("requires", "mic"),
    [
        (ASKS, STALE),
        ([{**ASKS[0], "hold": "2s"}], MIC),
        ([*ASKS, {"task": "speech"}], MIC),
        ([{"when": "mic.level > 0.05 && age(mic) < 2.0"}], MIC),
    ],
)
def test_a_pre_condition_that_can_end_is_not_reported(requires, mic):
    policy = a_robot(TURNED, slam={"requires": requires}, mic=mic)
    assert frozen(policy) == []
    during = [plan for plan in run_story(policy).plans if plan.contexts]
    assert during[-1].tasks["slam"].suspended


@pytest.mark.parametrize("when", ["heard(mic)", "mic.often < 1", "imu.x > 1", "mic.on", "mic.state == 'up'"])
def test_a_pre_condition_may_ask_for_something_else(when):
    counted = {**MIC, "features": [{"name": "often", "op": "count", "over": "2s"}]}
    assert frozen(a_robot(TURNED, slam={"requires": [{"when": when}]}, mic=counted)) == []


def test_it_may_ask_a_context_for_the_value():
    loud = a_context("loud", "mic.level > 0.05", OTHER)
    assert frozen(a_robot(TURNED, loud, slam={"requires": [{"when": "contexts.loud"}]})) != []


NEEDS = "needs quiet, which suspends speech, which produces mic: holds at most until that is stale"


def test_a_condition_that_needs_the_context_that_silences_its_stream():
    loud = a_context("loud", "contexts.quiet && mic.level > 0.5", OTHER)
    assert reported(a_robot(TURNED, loud, mic=STALE)) == [NEEDS]
    assert reported(a_robot(TURNED, loud)) == []
    either = a_context("either", "contexts.quiet && (imu.x > 1 || mic.level > 0.5)", OTHER)
    assert reported(a_robot(TURNED, either, mic=STALE)) == []


@pytest.mark.parametrize(
    ("scores", "rests"),
    [
        ("contexts.wary ? 0.0 : 1.0", True),
        ("contexts.wary ? 0 : 1", True),
        ("contexts.wary ? 0.5 : 1.0", False),
        ("imu.x > 1 ? 0.0 : 1.0", False),
    ],
)
def test_a_task_that_scores_0_in_a_context_rests_in_it(scores, rests):
    wary = a_context("wary", "mic.level > 0.3", OTHER, exitAfter="1ms")
    tasks = [a_task("speech", activity=[{"scoreFrom": scores}]), a_task("slam"), a_task("rest")]
    policy = a_policy(streams=[MIC, a_stream("imu")], tasks=tasks, contexts=[wary])
    message = "context wary leaves at rest speech, which produces mic: nothing else ends it, so once begun it holds"
    assert [one.startswith(message) for one in reported(policy) if "for ever" in one] == [True] * rests
    assert (run_story(policy).last.tasks["speech"].weight == 0) is rests


STARVED = {"needs": {"cores": "500m", "enforce": "Suspend"}}
CAPPED = a_context("hot", "mic.level > 0.3", {"speech": {"max": "300m"}}, until="mic.level < 0.2")


@pytest.mark.parametrize(
    ("speech", "later", "suspends"),
    [
        (STARVED, {"slam": {"max": "1"}}, True),
        (STARVED, {"speech": {"max": "1"}}, False),
        ({"needs": {"cores": "500m"}}, {"slam": {"max": "1"}}, False),
    ],
)
def test_a_max_below_what_a_task_must_have_suspends_it(speech, later, suspends):
    tasks = [a_task("speech", **speech), a_task("slam")]
    contexts = [CAPPED, a_context("later", "imu.x < 9", later, exitAfter="1ms")]
    policy = a_policy(streams=[MIC, a_stream("imu")], tasks=tasks, contexts=contexts)
    found = [one for one in reported(policy) if "for ever" in one]
    message = "context hot suspends speech, which produces mic: nothing else ends it, so once begun it holds for ever"
    assert found == [message] * suspends
    assert run_story(policy).last.tasks["speech"].suspended is suspends


NEEDED = "needs context quiet, during which speech can't run"


def in_need(**speech):
    tasks = [a_task("speech", **speech), a_task("slam"), a_task("rest")]
    return a_policy(streams=[a_stream("imu"), MIC], tasks=tasks, contexts=[TURNED])


@pytest.mark.parametrize(
    "speech",
    [
        {"requires": [{"when": "contexts.quiet"}]},
        {"requires": [{"when": "contexts.quiet && imu.x > 1"}]},
        {"activity": [{"when": "contexts.quiet"}]},
    ],
)
def test_a_task_that_waits_for_the_context_that_suspends_it_is_reported(speech):
    policy = in_need(**speech)
    assert NEEDED in reported(policy)
    assert {plan.tasks["speech"].weight for plan in run_story(policy).plans} == {0}


@pytest.mark.parametrize(
    "speech",
    [
        {"requires": [{"when": "contexts.quiet", "hold": "2s"}]},
        {"requires": [{"when": "!contexts.quiet"}]},
        {"requires": [{"when": "contexts.quiet || imu.x < 0"}]},
        {"activity": [{"when": "contexts.quiet", "hold": "2s"}]},
        {"activity": [{"when": "contexts.quiet", "decay": "2s"}]},
        {"activity": [{"when": "contexts.quiet", "until": "mic.level > 1"}]},
        {"requires": [{"when": "contexts.quiet"}], "protected": True},
    ],
)
def test_a_task_that_may_run_before_or_after_that_context_is_not_reported(speech):
    assert NEEDED not in reported(in_need(**speech))
