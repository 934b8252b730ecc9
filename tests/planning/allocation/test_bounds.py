"""Bounds of a context: they narrow those of the task, in the division, in quotas and requests, and in explanations."""

from __future__ import annotations

from typing import Any

import pytest

from contextpolicy.actuators.order import order_of
from contextpolicy.errors import PolicyError
from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import sentences
from contextpolicy.planning.allocation.bounds import KNOWN, BoundedSeating, policy_within, within
from contextpolicy.policy.spec import Context, Effect, Task
from tests.planning.builders import START, Story, a_context, a_parent, a_policy, a_stream, a_task, on_node

HOT = "imu.heat > 70"


def policy_of(effect: Any, *more: Any, control: str = "Limit", **fields: Any) -> Any:
    tasks = [a_task("slam", priority=10, min="200m", max="1500m"), a_task("speech", priority=10)]
    contexts = [a_context("hot", HOT, {"slam": effect}), *more]
    enforcement = {"control": control, **fields}
    return a_policy(streams=[a_stream("imu")], tasks=tasks, contexts=contexts, enforcement=enforcement)


def heated(policy: Any, *readings: tuple[float, float]) -> Story:
    story = Story(policy, on_node("slam", "speech", cores=2.0))
    for at, heat in readings:
        story.sample("imu", at=at, heat=heat)
    return story


def test_a_cap_holds_while_its_context_does() -> None:
    story = heated(policy_of({"max": "500m"}))
    assert story.shares() == {"slam": 1000, "speech": 1000}
    story.sample("imu", at=1, heat=80)
    assert story.shares() == {"slam": 500, "speech": 1500}
    story.sample("imu", at=2, heat=60)
    assert story.shares() == {"slam": 1000, "speech": 1000}


def test_a_floor_holds_while_its_context_does() -> None:
    story = heated(policy_of({"min": "1200m", "scale": 0.1}), (1, 80))
    assert story.shares() == {"slam": 1200, "speech": 800}


EFFECTS: list[tuple[list[Effect], tuple[int, int | None]]] = [
    ([], (200, 1500)),
    ([Effect(max=500)], (200, 500)),
    ([Effect(max=500), Effect(max=1000)], (200, 1000)),
    ([Effect(max=500), Effect(weight=3.0)], (200, 500)),
    ([Effect(min=400), Effect(max=300)], (300, 300)),
    ([Effect(max=300), Effect(min=400)], (400, 400)),
]


@pytest.mark.parametrize(("effects", "expected"), EFFECTS)
def test_later_contexts_override_bounds(effects: list[Effect], expected: tuple[int, int | None]) -> None:
    contexts = [Context(f"c{number}", effects={"slam": effect}) for number, effect in enumerate(effects)]
    task = within(Task("slam", min=200, max=1500), contexts)
    assert (task.min, task.max) == expected


def test_a_task_without_max_may_be_capped() -> None:
    assert within(Task("slam"), [Context("hot", effects={"slam": Effect(max=300)})]).max == 300


@pytest.mark.parametrize("control", ["Weight", "Suspend"])
def test_a_cap_is_the_quota_under_weight_and_suspend(control: str) -> None:
    policy = policy_of({"max": "500m"}, control=control)
    story = heated(policy, (1, 80), (2, 60))
    quotas = []
    for plan in {plan.sequence: plan for plan in story.plans if plan.nodes}.values():
        order = order_of(policy, story.planner.placement.containers, plan.nodes, realtime=(), agents=())
        quotas.append(order.limits["slam@robot"])
        assert order.requests.get("slam@robot", 0) <= (order.limits["slam@robot"] or 0)
    assert quotas == [1500, 500, 1500]


def test_a_cap_that_changes_no_share_makes_a_new_plan() -> None:
    """Under Weight the share may be the same, below the cap: the quota must follow nevertheless."""
    story = heated(policy_of({"max": "1200m"}, control="Weight"), (1, 80))
    first, second = story.plans[-2:]
    assert story.shares() == {"slam": 1000, "speech": 1000}
    assert second.sequence == first.sequence + 1


def test_min_dwell_keeps_the_cap_of_the_plan_in_force() -> None:
    story = heated(policy_of({"max": "500m"}, control="Weight", minDwell="10s"), (1, 80))
    assert story.last.nodes["robot"].caps == {}
    story.wait(11)
    assert story.last.nodes["robot"].caps == {"slam": 500}


def test_a_new_placement_is_seated_within_the_bounds() -> None:
    story = heated(policy_of({"max": "500m"}), (1, 80))
    story.place(on_node("slam", "speech", cores=4.0), at=2)
    assert story.shares() == {"slam": 500, "speech": 3500}


def test_explanations_use_the_bounds_of_the_context() -> None:
    message = sentences(explain(heated(policy_of({"max": "500m", "scale": 0.9}), (1, 80)).planner, START + 1), "slam")
    assert "Context hot scales its weight by 0.9 and caps it at 500m." in message
    assert "Its ceiling holds it at 500m." in message


REFUSED: list[tuple[Any, Any, str]] = [
    (
        {"min": "100m"},
        {},
        "tasks.slam.min: invalid value '100m': expected at least the task's min, 200m and at most its max, 1500m",
    ),
    ({"max": 2}, {}, "slam.max: invalid value '2': expected at least the task's min, 200m and at most its max, 1500m"),
    ({"max": "300m"}, {"suspendedCpu": "400m"}, "max: invalid value '300m': expected at least suspendedCpu, 400m"),
    ({"min": "800m", "max": "700m"}, {}, "at least the context's min, 800m"),
]


@pytest.mark.parametrize(("effect", "fields", "message"), REFUSED)
def test_bounds_outside_those_of_the_task_are_refused(effect: Any, fields: Any, message: str) -> None:
    slam = a_task("slam", min="200m", max="1500m", **fields)
    with pytest.raises(PolicyError) as caught:
        a_policy(tasks=[slam], contexts=[a_context("hot", "true", {"slam": effect})])
    assert [message in str(finding) for finding in caught.value.findings] == [True]


def test_a_group_has_no_bounds() -> None:
    with pytest.raises(PolicyError, match="a task with subtasks has no container"):
        a_policy(
            tasks=[a_parent("all", "slam"), a_task("slam")], contexts=[a_context("x", "true", {"all": {"max": 1}})]
        )


def test_few_combinations_of_contexts_are_remembered() -> None:
    """A policy may have more of them than there is memory."""
    names = [f"ctx{number}" for number in range(8)]
    contexts = [a_context(name, tasks={"slam": {"max": f"{number + 2}00m"}}) for number, name in enumerate(names)]
    policy = a_policy(streams=[a_stream("imu")], tasks=[a_task("slam")], contexts=contexts)
    seating = BoundedSeating(policy)
    seating.place(on_node("slam", cores=2))
    for chosen in range(2 ** len(names)):
        active = [context for place, context in enumerate(policy.contexts) if chosen >> place & 1]
        (seated,) = seating.seating(active).nodes
        assert seated.seats[0].ceiling == (policy_within(policy, active).tasks[0].max or 2000) // 10
    assert len(seating._placed) <= KNOWN
