"""Why a plan is made: the stream, the condition and its value that a message names."""

from __future__ import annotations

from tests.planning.builders import START, Story, a_policy, a_stream, a_task
from tests.planning.two_streams import two_streams


def test_the_cause_names_the_stream_the_condition_and_its_value():
    story = Story(two_streams())
    story.sample("imu", at=1, speed=1.0)
    assert story.last.cause == "imu: imu.speed > 0.1 is 1; imu: context moving entered"


FALLING = {"stream": "imu", "when": "imu.hit", "score": 10, "hold": "1s", "decay": "10s"}
"""From 2 s on it loses 1 each second."""


def falling(*activity, **task):
    """Slam's event of 1 s decays; `mic.on` is the cause of other plans."""
    tasks = [a_task("slam", activity=[FALLING, *activity], **task), a_task("speech", activity=[{"when": "mic.on"}])]
    story = Story(a_policy(streams=[a_stream("imu"), a_stream("mic")], tasks=[*tasks, a_task("rest")]))
    story.sample("imu", at=1, hit=True)
    return story


def test_a_decay_below_idle_is_not_a_cause():
    story = falling(idle=5)
    story.wait(6.9)
    assert story.last.cause == "imu: imu.hit is 6"
    story.sample("mic", at=8, on=True)
    assert (story.last.tasks["slam"].score, story.last.cause) == (5.0, "mic: mic.on is 1")


def test_the_cause_of_the_last_decay_step_names_the_idle_score():
    story = falling(idle=5.5)
    story.wait(7)
    assert story.last.cause == "imu: imu.hit is 5, but slam already scores 5.5"
    story.wait(20)
    assert story.last.time == START + 7


def test_a_decay_below_another_activity_is_not_a_cause():
    story = falling({"when": "mic.on", "score": 20})
    story.wait(2.5)
    story.sample("mic", at=3, on=True)
    assert (story.last.tasks["slam"].score, story.last.cause) == (20.0, "mic: mic.on is 20; mic: mic.on is 1")


def test_a_held_back_plan_names_the_final_cause():
    tasks = [a_task("slam", activity=[FALLING, {"when": "mic.on", "score": 20}]), a_task("rest")]
    policy = a_policy(streams=[a_stream("imu"), a_stream("mic")], tasks=tasks, enforcement={"minDwell": "9s"})
    story = Story(policy)
    story.sample("imu", at=1, hit=True)
    story.wait(3.5)
    story.sample("mic", at=4, on=True)
    story.wait(9)
    assert (story.last.sequence, story.last.cause) == (3, "mic: mic.on is 20")


def test_a_pre_condition_and_an_event_are_two_causes():
    tasks = [a_task("slam", activity=[{"when": "imu.hit"}], requires=[{"when": "imu.on"}]), a_task("rest")]
    story = Story(a_policy(streams=[a_stream("imu")], tasks=tasks))
    story.sample("imu", at=1, hit=True, on=True)
    assert story.last.cause == "imu: imu.hit is 1; imu: imu.on is 1"


def test_a_late_call_makes_one_plan_for_each_instant():
    activity = [{"stream": "imu", "hold": "1s"}, {"stream": "imu", "hold": "2s", "score": 0.5}]
    policy = a_policy(streams=[a_stream("imu")], tasks=[a_task("slam", activity=activity), a_task("rest")])
    story = Story(policy)
    story.sample("imu", at=1)
    story.wait(1e6)
    assert [(plan.time - START, plan.tasks["slam"].score) for plan in story.plans[-3:]] == [
        (1, 1.0),
        (2, 0.5),
        (3, 0.0),
    ]
