"""Only a sample is an event: what changes with time alone never begins nor renews a hold."""

from __future__ import annotations

import pytest

from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task

COUNTED = a_stream("btn", features=[{"name": "presses", "op": "count", "over": "30s"}])
WHILE_COUNTED = {"when": "btn.presses >= 1", "hold": "2s"}
WHILE_PRESSED = {"stream": "btn", "hold": "2s"}


def intervals(story):
    """When slam was active, in seconds: [(from, to), ...]."""
    found, since = [], None
    for plan in story.plans:
        active = plan.tasks["slam"].weight > 0
        if active and since is None:
            since = plan.time - START
        if not active and since is not None:
            found.append((since, plan.time - START))
            since = None
    return found


def press(policy, *moments, until):
    story = Story(policy)
    for at in moments:
        story.sample("btn", at=at, pressed=True)
    story.wait(until)
    return story


@pytest.mark.parametrize(
    "task",
    [
        {"activity": [WHILE_PRESSED]},
        {"activity": [{"when": "btn.pressed", "hold": "2s"}]},
        {"requires": [{"when": "btn.pressed", "hold": "2s"}]},
    ],
)
def test_a_sliding_window_starts_no_activity(task):
    policy = a_policy(streams=[COUNTED], tasks=[a_task("slam", **task)])
    assert intervals(press(policy, 1, until=60)) == [(1, 3)]


@pytest.mark.parametrize("field", ["activity", "requires"])
def test_a_window_of_another_task_does_not_extend_a_hold(field):
    holding = {"when": "btn.pressed", "hold": "5s"}
    stream = a_stream("btn", features=[{"name": "presses", "op": "count", "over": "3s"}])
    other = a_task("other", activity=[{"when": "btn.presses > 1"}])
    policy = a_policy(streams=[stream], tasks=[a_task("slam", **{field: [holding]}), other])
    assert intervals(press(policy, 1, until=60)) == [(1, 6)]


def test_a_sliding_window_starts_no_hold():
    policy = a_policy(
        streams=[COUNTED],
        tasks=[a_task("slam", activity=[{"when": "btn.presses == 1", "hold": "2s"}])],
    )
    assert intervals(press(policy, 1, 5, until=100)) == [(1, 3)], "from 31 to 35 s the window holds one press again"


def test_a_sliding_window_changes_conditions_without_hold():
    policy = a_policy(
        streams=[COUNTED],
        tasks=[a_task("slam", activity=[{"when": "btn.presses == 1"}])],
        contexts=[a_context("busy", "btn.presses > 0")],
    )
    story = press(policy, 1, 5, until=100)
    assert intervals(story) == [(1, 5), (31, 35)]
    assert story.contexts_over_time() == [(0, ()), (1, ("busy",)), (35, ())]


def test_the_end_of_a_hold_does_not_end_its_condition():
    story = press(a_policy(streams=[COUNTED], tasks=[a_task("slam", activity=[WHILE_COUNTED])]), 1, until=20)
    assert story.last.cause == "btn: the hold of btn.presses >= 1 is over"
    until = WHILE_COUNTED | {"until": "btn.presses >= 2"}
    story = press(a_policy(streams=[COUNTED], tasks=[a_task("slam", activity=[until])]), 1, 2, until=20)
    assert story.last.cause == "btn: btn.presses >= 1 is 0"


@pytest.mark.parametrize("field", ["activity", "requires"])
@pytest.mark.parametrize(
    ("when", "fields"),
    [
        ("age(btn) > 2.0", {}),
        ("!heard(btn)", {"staleAfter": "3s"}),
        ("contexts.lost", {"staleAfter": "3s"}),
        ("btn.presses < 1", {}),
    ],
)
def test_without_hold_any_change_counts(field, when, fields):
    policy = a_policy(
        streams=[COUNTED | fields],
        tasks=[a_task("slam", **{field: [{"when": when}]})],
        contexts=[a_context("lost")],
        fallback="lost",
    )
    assert press(policy, 1, until=2).weights()["slam"] == 0
    assert press(policy, 1, until=100).weights()["slam"] > 0


def test_a_window_that_slides_can_end_a_held_event():
    activity = {"when": "btn.presses > 0", "until": "btn.presses == 0", "hold": "60s"}
    policy = a_policy(streams=[COUNTED], tasks=[a_task("slam", activity=[activity])])
    assert intervals(press(policy, 1, until=100)) == [(1, 31)]


@pytest.mark.parametrize("when", ["age(imu) > 3", "!heard(imu)", "btn.pressed || !heard(imu)"])
def test_neither_age_nor_silence_is_an_event(when):
    streams = [a_stream("imu", staleAfter="2s"), a_stream("btn")]
    policy = a_policy(streams=streams, tasks=[a_task("slam", activity=[{"when": when, "hold": "2s"}])])
    story = Story(policy)
    story.sample("imu", at=1, speed=0.0)
    story.wait(20)
    assert intervals(story) == []


def test_an_edit_is_not_an_event():
    story = press(a_policy(streams=[COUNTED], tasks=[a_task("slam", idle=0)]), 1, until=10)
    edited = type(story.planner)(
        a_policy(streams=[COUNTED], tasks=[a_task("slam", activity=[WHILE_PRESSED])]), story, {}
    )
    edited.start(START + 10, story.planner)
    assert edited.scores() == {"slam": 0.0}


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        ("btn.pressed && contexts.busy", [(1, 3), (5, 7)]),
        ("btn.pressed && !contexts.busy", []),
        ("contexts.busy", [(1, 3)]),
        ("!contexts.busy", []),
    ],
)
def test_a_context_change_is_an_event_if_no_stream_is_read(when, expected):
    activity = {"when": when, "hold": "2s"}
    contexts = [a_context("busy", "btn.presses > 0")]
    policy = a_policy(streams=[COUNTED], tasks=[a_task("slam", activity=[activity])], contexts=contexts)
    assert intervals(press(policy, 1, 5, until=100)) == expected


def test_a_fallback_that_continues_by_its_condition_does_not_change():
    policy = a_policy(
        streams=[a_stream("imu", staleAfter="2s")],
        tasks=[a_task("slam", activity=[{"when": "contexts.safe", "hold": "3s"}])],
        contexts=[a_context("safe", "imu.slow")],
        fallback="safe",
    )
    story = Story(policy)
    story.wait(10)
    story.sample("imu", at=11, slow=True)
    story.sample("imu", at=12, slow=False)
    story.sample("imu", at=13, slow=True)
    story.wait(20)
    assert intervals(story) == [(13, 16)]


@pytest.mark.parametrize("field", ["activity", "requires"])
@pytest.mark.parametrize("when", ["btn.presses == 0", "age(btn) > 3.0", "!heard(btn)"])
def test_context_changes_by_time_or_silence_are_not_events(field, when):
    task = a_task("slam", **{field: [{"when": "contexts.quiet", "hold": "2s"}]})
    contexts = [a_context("quiet", "contexts.still"), a_context("still", when, enterAfter="1s")]
    streams = [COUNTED | {"staleAfter": "10s"}]
    assert intervals(press(a_policy(streams=streams, tasks=[task], contexts=contexts), 1, until=60)) == []


@pytest.mark.parametrize(("delay", "expected"), [({}, [(1, 3)]), ({"enterAfter": "4s"}, [(5, 7)])])
def test_a_context_begun_by_a_sample_is_an_event_even_after_a_delay(delay, expected):
    task = a_task("slam", activity=[{"when": "contexts.pressed", "hold": "2s"}])
    contexts = [a_context("pressed", "contexts.down"), a_context("down", "btn.pressed", **delay)]
    assert intervals(press(a_policy(streams=[COUNTED], tasks=[task], contexts=contexts), 1, until=60)) == expected


def test_a_forced_context_is_not_an_event():
    task = a_task("slam", activity=[{"when": "contexts.manual", "hold": "2s"}])
    force = {"context": "manual", "until": "1970-01-01T00:16:45Z"}
    story = Story(a_policy(streams=[COUNTED], tasks=[task], contexts=[a_context("manual")], force=force))
    story.wait(20)
    assert intervals(story) == []


def test_an_activity_without_streams_is_always_in_force():
    task = a_task("slam", activity=[{"when": "true", "hold": "1s"}], requires=[{"when": "true", "hold": "1s"}])
    story = press(a_policy(streams=[COUNTED], tasks=[task]), 3, until=60)
    assert story.plans[-1].tasks["slam"].weight == 1
