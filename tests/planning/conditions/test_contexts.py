"""When contexts hold, and what they do to weights."""

from __future__ import annotations

from datetime import UTC, datetime

from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task, on_node

MOVING = "imu.speed > 0.0"


def story_with(*contexts, streams=None, **fields):
    policy = a_policy(
        streams=streams or [a_stream("imu")],
        tasks=[a_task("slam", priority=10), a_task("speech", priority=2)],
        contexts=list(contexts),
        **fields,
    )
    return Story(policy, on_node("slam", "speech", cores=2))


def speeds(story, *readings):
    for at, speed in readings:
        story.sample("imu", at=at, speed=speed)


def test_an_interruption_restarts_enter_after():
    story = story_with(a_context("moving", MOVING, enterAfter="1s"))
    speeds(story, (1, 1.0), (1.5, 0.0), (2, 1.0), (2.5, 1.0))
    story.wait(9)
    assert story.contexts_over_time() == [(0, ()), (3, ("moving",))]


def test_exit_after_keeps_it_through_short_breaks():
    story = story_with(a_context("moving", MOVING, exitAfter="1s"))
    speeds(story, (1, 1.0), (2, 0.0), (2.9, 1.0), (4, 0.0))
    story.wait(9)
    assert story.contexts_over_time() == [(0, ()), (1, ("moving",)), (5, ())]


def test_a_delay_does_not_restart_with_every_sample():
    story = story_with(a_context("moving", MOVING, enterAfter="1s"))
    speeds(story, *((1 + n / 10, 1.0) for n in range(30)))
    assert story.contexts_over_time()[-1] == (2, ("moving",))


def test_silence_ends_a_context_by_its_exit_delay():
    story = story_with(a_context("moving", MOVING, exitAfter="5s"), streams=[a_stream("imu", staleAfter="1s")])
    speeds(story, (0.5, 1.0))
    story.wait(9)
    assert story.contexts_over_time() == [(0, ()), (0.5, ("moving",)), (6.5, ())]


def test_a_stream_that_is_heard_again_in_time_keeps_its_context():
    story = story_with(a_context("moving", MOVING, exitAfter="5s"), streams=[a_stream("imu", staleAfter="1s")])
    speeds(story, (0.5, 1.0), (6.4, 1.0))
    story.wait(7)
    assert story.contexts_over_time() == [(0, ()), (0.5, ("moving",))]


def test_silence_ends_the_wait_to_enter():
    story = story_with(a_context("moving", MOVING, enterAfter="5s"), streams=[a_stream("imu", staleAfter="1s")])
    speeds(story, (0.5, 1.0))
    story.wait(20)
    assert story.contexts_over_time() == [(0, ())]


def test_a_condition_over_two_streams_needs_both():
    streams = [a_stream("imu"), a_stream("arm", staleAfter="2s")]
    story = story_with(a_context("carrying", f"{MOVING} && arm.load > 0.5"), streams=streams)
    story.sample("arm", at=0.5, load=1.0)
    speeds(story, (1, 1.0))
    story.wait(9)
    assert story.contexts_over_time() == [(0, ()), (1, ("carrying",)), (2.5, ())]


def test_a_context_can_wake_a_task_without_activity():
    policy = a_policy(
        streams=[a_stream("imu")],
        tasks=[a_task("slam"), a_task("speech", idle=0)],
        contexts=[a_context("moving", MOVING, tasks={"speech": {"weight": 1}})],
    )
    story = Story(policy)
    assert story.last.tasks["speech"].suspended
    speeds(story, (1, 1.0))
    assert story.shares() == {"slam": 500, "speech": 500}


def test_a_context_cannot_wake_a_task_whose_pre_condition_fails():
    policy = a_policy(
        streams=[a_stream("imu"), a_stream("mic")],
        tasks=[a_task("slam"), a_task("speech", requires=[{"when": "mic.level > 0.1"}])],
        contexts=[a_context("moving", MOVING, tasks={"speech": {"weight": 9}})],
    )
    story = Story(policy)
    speeds(story, (1, 1.0))
    assert story.last.tasks["speech"].because == "waits for mic.level > 0.1"


class TestForce:
    def story(self, until, **context):
        moment = datetime.fromtimestamp(START + until, UTC).isoformat()
        return story_with(
            a_context("care", context.pop("when", None), tasks={"slam": {"weight": 1}}, **context),
            force={"context": "care", "until": moment},
        )

    def test_it_holds_from_the_start_until_its_expiry(self):
        story = self.story(60)
        story.wait(100)
        assert story.contexts_over_time() == [(0, ("care",)), (60, ())]
        assert "care exited" in story.last.cause

    def test_an_expired_force_is_ignored(self):
        story = self.story(-1)
        assert story.contexts_over_time() == [(0, ())]
        assert story.next_decision() is None

    def test_it_holds_regardless_of_its_condition(self):
        story = self.story(60, when=MOVING)
        speeds(story, (1, 0.0))
        assert story.last.contexts == ("care",)

    def test_a_condition_that_holds_keeps_the_context_past_the_expiry(self):
        story = self.story(60, when=MOVING)
        speeds(story, (1, 1.0))
        story.wait(100)
        assert story.last.contexts == ("care",)
        speeds(story, (101, 0.0))
        assert story.last.contexts == ()
