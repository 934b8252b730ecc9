"""Scores from events: conditions, numbers, hold, decay, several activities, pre-conditions."""

from __future__ import annotations

import pytest

from contextpolicy.planning.inputs import Score
from tests.planning.builders import START, Story, a_policy, a_stream, a_task, on_node


def scoring(*activity, streams=("imu",), **task):
    """A story and a function that returns slam's score over time."""
    policy = a_policy(
        streams=[a_stream(name, staleAfter="10s" if name == "imu" else None) for name in streams],
        tasks=[a_task("slam", activity=list(activity), **task), a_task("other")],
    )
    return Story(policy, on_node("slam", "other", cores=4))


def scores(story, task="slam"):
    """The task's score over time, from its first change on."""
    seen: list[tuple[float, float]] = []
    for plan in story.plans:
        score = plan.tasks[task].score
        if not seen or seen[-1][1] != score:
            seen.append((round(plan.time - START, 6), score))
    return seen[1:]


def test_an_activity_scores_while_its_condition_holds():
    story = scoring({"stream": "imu", "when": "imu.speed > 0.1", "score": 2})
    for at, speed in ((1, 1.0), (2, 5.0), (3, 0.0)):
        story.sample("imu", at=at, speed=speed)
    assert scores(story) == [(1, 2.0), (3, 0.0)]


def test_hold_keeps_the_score_after_the_event():
    story = scoring({"stream": "imu", "when": "imu.speed > 0.1", "hold": "1s"})
    story.sample("imu", at=1, speed=1.0)
    story.sample("imu", at=1.1, speed=0.0)
    story.sample("imu", at=1.5, speed=1.0)
    story.wait(5)
    assert scores(story) == [(1, 1.0), (2.5, 0.0)]


def test_decay_falls_in_ten_steps_from_the_end_of_the_hold():
    story = scoring({"stream": "imu", "when": "imu.hit", "score": 10, "hold": "1s", "decay": "5s"})
    story.sample("imu", at=1, hit=True)
    story.wait(20)
    steps = [(round(2 + 0.5 * n, 6), 10.0 - n) for n in range(1, 11)]
    assert scores(story) == [(1, 10.0), *steps]


def test_decay_without_hold_falls_while_the_condition_fails():
    story = scoring({"stream": "imu", "when": "imu.hit", "score": 10, "decay": "1s"})
    story.sample("imu", at=1, hit=True)
    story.sample("imu", at=2, hit=False)
    story.sample("imu", at=2.05, hit=False)
    story.wait(2.35)
    assert story.last.tasks["slam"].score == 7.0
    story.wait(9)
    assert scores(story)[-1] == (3.0, 0.0)


def test_a_new_event_ends_the_decay():
    story = scoring({"stream": "imu", "when": "imu.hit", "score": 10, "decay": "1s"})
    story.sample("imu", at=1, hit=True)
    story.sample("imu", at=2, hit=False)
    story.sample("imu", at=2.5, hit=True)
    story.wait(9)
    assert scores(story)[-1] == (2.5, 10.0)


@pytest.mark.parametrize("hold", [{}, {"hold": "1s"}])
def test_a_decaying_score_stops_at_idle(hold):
    story = scoring({"stream": "imu", "when": "imu.hit", "decay": "1s", **hold}, idle=0.45)
    story.sample("imu", at=1, hit=True)
    story.sample("imu", at=1.1, hit=False)
    story.wait(9)
    values = [value for _, value in scores(story)]
    assert values == [1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.45]


def test_an_activity_below_idle_does_not_lower_the_score():
    story = scoring({"when": "imu.hit", "score": 0.1}, idle=0.2)
    story.sample("imu", at=1, hit=True)
    assert story.planner.scores()["slam"] == 0.2


def test_the_strongest_held_event_counts_until_it_ends_then_the_next():
    story = scoring({"scoreFrom": "imu.risk", "hold": "10s"})
    for at, risk in ((1, 5.0), (2, 1.0), (3, 3.0), (4, 2.0)):
        story.sample("imu", at=at, risk=risk)
    story.sample("imu", at=9, risk=0.0)
    story.wait(30)
    assert scores(story) == [(1, 5.0), (11, 3.0), (13, 2.0), (14, 0.0)]


def test_a_decaying_event_stops_at_the_next_held_one():
    story = scoring({"scoreFrom": "imu.risk", "hold": "2s", "decay": "10s"})
    story.sample("imu", at=1, risk=10.0)
    story.sample("imu", at=2.5, risk=8.5)
    story.wait(30)
    assert scores(story)[:7] == [(1, 10.0), (4, 9.0), (5, 8.5), (5.5, 8.0), (6, 7.65), (6.5, 7.0), (7, 6.8)]
    assert scores(story)[-1] == (14.5, 0.0)


def test_a_decaying_event_counts_until_permanently_overtaken():
    story = scoring({"scoreFrom": "imu.risk", "hold": "500ms", "decay": "5s"})
    story.sample("imu", at=1, risk=3.0)
    story.sample("imu", at=2.25, risk=2.0)
    story.wait(30)
    # From 3.5 s on both score 1.8. The later one falls to 1.6 at 3.75 s, the earlier one to 1.5 at 4 s.
    assert scores(story)[3:8] == [(3.0, 2.1), (3.5, 1.8), (4.0, 1.6), (4.25, 1.5), (4.5, 1.4)]
    assert scores(story)[8:10] == [(4.75, 1.2), (5.25, 1.0)]


def test_number_of_decaying_events_is_bounded():
    story = scoring({"scoreFrom": "imu.risk", "hold": "10ms", "decay": "1s"})
    for tick in range(3000):
        story.sample("imu", at=1 + tick / 1000, risk=30_000.0 - tick)
    # Those of the hold and of two of the ten steps: 210 ms.
    assert len(story.planner.initiatives["slam"][0]._events) <= 211


def test_a_weaker_event_does_not_lower_a_decaying_score():
    story = scoring({"scoreFrom": "imu.risk", "decay": "10s"})
    for at, risk in ((1, 10.0), (2, 0.0), (4.5, 4.0), (6.5, 7.0), (6.6, 6.5), (8.5, 0.0)):
        story.sample("imu", at=at, risk=risk)
    assert scores(story) == [(1, 10.0), (3, 9.0), (4, 8.0), (5, 7.0), (6, 6.0), (6.5, 7.0), (6.6, 6.5)]


def test_number_of_held_events_is_bounded():
    story = scoring({"scoreFrom": "imu.risk", "hold": "60s"})
    for tick in range(3000):
        story.sample("imu", at=1 + tick / 1000, risk=3001.0 - tick)
    assert len(story.planner.initiatives["slam"][0]._events) == 1000
    assert story.planner.scores()["slam"] == 3001.0
    story.wait(70)
    assert story.planner.scores()["slam"] == 0.0


def test_an_event_is_held_through_silence():
    story = scoring({"stream": "imu", "when": "imu.hit", "hold": "60s"})
    story.sample("imu", at=1, hit=True)
    story.wait(100)
    assert scores(story) == [(1, 1.0), (61.0, 0.0)]


def test_without_hold_silence_starts_the_decay():
    story = scoring({"stream": "imu", "when": "imu.hit", "score": 10, "decay": "10s"})
    story.sample("imu", at=1, hit=True)
    story.wait(100)
    assert scores(story) == [(1, 10.0), *((12.0 + n, 9.0 - n) for n in range(10))]


def test_an_activity_without_condition_scores_while_the_stream_speaks():
    story = scoring({"stream": "imu"})
    story.sample("imu", at=1, anything=1)
    story.wait(100)
    assert scores(story) == [(1, 1.0), (11.0, 0.0)]


def test_score_from_reads_the_score_off_the_sample():
    story = scoring({"scoreFrom": "imu.risk * 2.0"})
    story.sample("imu", at=1, risk=1.5)
    story.sample("imu", at=2, risk=0.25)
    story.sample("imu", at=3, risk=-1.0)
    assert scores(story) == [(1, 3.0), (2, 0.5), (3, 0.0)]


def test_score_from_counts_only_while_the_condition_holds():
    story = scoring({"when": "imu.ok", "scoreFrom": "imu.risk"})
    story.sample("imu", at=1, ok=True, risk=2.0)
    story.sample("imu", at=2, ok=False, risk=3.0)
    assert scores(story) == [(1, 2.0), (2, 0.0)]


@pytest.mark.parametrize("risk", ["high", None, True, float("nan"), float("inf"), [1.0]])
def test_a_score_that_is_not_a_finite_number_counts_as_none(risk):
    story = scoring({"scoreFrom": "imu.risk"})
    story.sample("imu", at=1, risk=2.0)
    story.sample("imu", at=2, risk=risk)
    assert scores(story)[-1] == (2, 0.0)
    assert story.drops()["", "expression"] == 1
    assert "imu.risk" in story.planner.errors


def test_the_strongest_of_several_activities_counts():
    story = scoring(
        {"when": "imu.speed > 0.1", "score": 1},
        {"when": "mic.level > 0.5", "score": 3, "hold": "2s"},
        streams=("imu", "mic"),
    )
    story.sample("imu", at=1, speed=1.0)
    story.sample("mic", at=2, level=0.9)
    story.wait(9)
    assert scores(story) == [(1, 1.0), (2, 3.0), (4, 1.0)]


@pytest.mark.parametrize(
    ("task", "expected"),
    [({}, 1.0), ({"idle": 0.2}, 0.2), ({"activity": [{"when": "imu.hit"}]}, 0.0)],
)
def test_the_score_without_fresh_activity(task, expected):
    story = Story(a_policy(streams=[a_stream("imu")], tasks=[a_task("slam", **task), a_task("other")]))
    assert story.last.tasks["slam"].score == expected


def test_an_activity_over_no_stream_is_in_force_from_the_start():
    story = scoring({"score": 4})
    assert story.planner.scores()["slam"] == 4.0


def test_an_expression_error_is_reported_and_recovers():
    story = scoring({"when": "norm(imu.gyro) > 0.1"})
    for gyro in ("abc", [1, "x"], None, 5, {"x": "y"}):
        story.sample("imu", at=1, gyro=gyro)
    story.sample("imu", at=1)
    assert story.drops() == {("", "expression"): 6}
    assert "gyro" in story.planner.errors["norm(imu.gyro) > 0.1"]
    story.sample("imu", at=2, gyro=[0.3, 0.4])
    assert scores(story)[-1] == (2, 1.0)


def test_a_failing_function_does_not_log(caplog, capfd):
    story = scoring({"when": "norm(imu.gyro) > 0.1"})
    story.sample("imu", at=1, gyro="abc")
    assert story.drops() == {("", "expression"): 1}
    assert caplog.records == []
    assert capfd.readouterr() == ("", "")


def test_requirements_suspend_until_met():
    requires = [{"when": "hit.seen", "hold": "1s"}, {"when": "mic.level > 0.1"}]
    story = scoring(requires=requires, streams=("hit", "mic"))
    assert story.last.tasks["slam"].because == "waits for hit.seen"
    story.sample("hit", at=1, seen=True)
    assert story.last.tasks["slam"].suspended
    story.sample("mic", at=1.5, level=1.0)
    assert not story.last.tasks["slam"].suspended
    story.wait(9)
    assert story.last.time == START + 2
    assert story.last.tasks["slam"].because == "waits for hit.seen"


class TestPluggedIn:
    """What the planner does with the scores of an instantiation function; `test_observable` runs real ones."""

    def story(self, **fields):
        streams = [a_stream("imu", staleAfter="10s")] if "stream" in fields else []
        task = a_task("slam", activity=[{"initiative": "curiosity", **fields}])
        return Story(a_policy(streams=streams, tasks=[task, a_task("other")]))

    def test_its_score_counts(self):
        story = self.story()
        story.take(Score("slam", 0, 2.5), at=1)
        story.take(Score("slam", 0, 0.0), at=2)
        assert scores(story) == [(1, 2.5), (2, 0.0)]

    def test_hold_and_decay_apply(self):
        story = self.story(hold="1s")
        story.take(Score("slam", 0, 2.5), at=1)
        story.wait(9)
        assert scores(story)[-1] == (2, 0.0)

    def test_its_stream_does_not_score_but_its_silence_ends_the_score(self):
        story = self.story(stream="imu")
        story.sample("imu", at=1, speed=1.0)
        assert story.planner.scores()["slam"] == 0.0
        story.take(Score("slam", 0, 2.5), at=2)
        story.sample("imu", at=3, speed=1.0)
        assert story.planner.scores()["slam"] == 2.5
        story.wait(100)
        assert scores(story)[-1] == (13, 0.0)

    @pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), "high", None, [1]])
    def test_a_non_finite_score_is_dropped_and_counted(self, value):
        story = self.story()
        story.take(Score("slam", 0, 2.5), at=1)
        story.take(Score("slam", 0, value), at=2)
        assert story.planner.scores()["slam"] == 2.5
        assert story.drops() == {("slam", "score not finite"): 1}
