"""When the first plan is made, and how long a plan stands at least."""

from __future__ import annotations

from contextpolicy.planning.planner import Planner
from tests.planning.builders import START, Story, a_policy, a_stream, a_task, on_node
from tests.planning.quiet import Quiet
from tests.planning.two_streams import two_streams


class TestFirstPlan:
    def policy(self):
        return a_policy(streams=[a_stream("imu", staleAfter="1m"), a_stream("mic")], tasks=[a_task("slam")])

    def test_it_waits_for_no_stream(self):
        assert [plan.time for plan in Story(self.policy()).plans][:1] == [START]

    def test_a_stream_added_by_an_edit_delays_no_plan(self):
        story = Story(a_policy(streams=[a_stream("mic")], tasks=[a_task("slam")]))
        planner = Planner(
            a_policy(streams=[a_stream("mic"), a_stream("imu", staleAfter="1m")], tasks=[a_task("slam")]),
            Quiet(),
            {},
        )
        assert [plan.time for plan in planner.start(START + 5, story.planner)] == [START + 5]


class TestMinDwell:
    def story(self):
        story = Story(two_streams(enforcement={"minDwell": "1s"}))
        story.wait(2)
        return story

    def test_a_plan_within_the_dwell_comes_at_its_end(self):
        story = self.story()
        story.sample("imu", at=2, speed=1.0)
        story.sample("imu", at=2.2, speed=0.0)
        assert story.planner.decided.time == START + 2
        story.wait(9)
        assert story.planner.decided.time == START + 3
        assert story.planner.held_back == 1

    def test_weights_and_contexts_are_current_during_the_dwell(self):
        story = self.story()
        story.sample("imu", at=2, speed=1.0)
        before = story.last
        story.sample("imu", at=2.2, speed=0.0)
        shown = story.last
        assert (shown.sequence, shown.time, shown.contexts) == (before.sequence, START + 2.2, ())
        assert shown.tasks["slam"].weight == 0
        assert not shown.tasks["slam"].suspended
        assert shown.nodes == before.nodes
        assert story.shares() == {name: task.share for name, task in before.tasks.items()}

    def test_flapping_back_in_time_makes_no_plan_but_is_counted(self):
        story = self.story()
        story.sample("imu", at=2, speed=1.0)
        story.sample("imu", at=2.2, speed=0.0)
        story.sample("imu", at=2.4, speed=1.0)
        story.wait(9)
        assert story.planner.decided.time == START + 2
        assert story.planner.held_back == 1

    def test_each_flap_counts_once_however_many_samples_it_has(self):
        story = self.story()
        story.sample("imu", at=2, speed=1.0)
        for tick in range(1, 90):
            story.sample("imu", at=2 + tick / 100, speed=0.0 if tick % 30 > 15 else 1.0)
        assert story.planner.held_back == 3

    def test_a_container_that_comes_or_goes_does_not_wait(self):
        story = self.story()
        story.sample("imu", at=2, speed=1.0)
        story.place(on_node("slam", "rest"), at=2.1)
        assert story.last.time == START + 2.1
        assert story.planner.held_back == 0

    def test_the_cause_stays_short_and_shows_the_latest(self):
        policy = a_policy(
            streams=[a_stream("imu")],
            tasks=[a_task("slam", activity=[{"scoreFrom": "imu.risk"}]), a_task("rest")],
            enforcement={"minDwell": "60s"},
        )
        story = Story(policy)
        for tick in range(1, 500):
            story.sample("imu", at=tick / 10, risk=float(tick))
        story.wait(70)
        assert story.last.cause == "imu: true is 499"
