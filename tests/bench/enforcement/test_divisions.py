"""What each division writes for each task in each context."""

import pytest

from contextpolicy.bus.plan_message import message
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT
from tests.bench.enforcement.divisions import (
    BUDGETS,
    CORE,
    DEFAULT,
    LEAST_SHARES,
    LIMITS,
    PINNED,
    PRIORITY,
    REALTIME,
    ROUND_ROBIN,
    STATIC,
    SUSPENSION,
    TUNED,
    WEIGHTS,
    Setting,
    division,
    kubelet_shares,
)
from tests.bench.enforcement.policy import ATTEMPTS, STEP, WEIGHTED
from tests.bench.enforcement.stories import IMPORTANCE, PROCESSORS, SUSPENDING, tasks
from tests.cluster.builders import NODE, a_pod, cpu
from tests.cluster.claiming import claim
from tests.planning.builders import Story, a_context, a_policy, a_task

HEAVY = tasks(1.3)
NAMES = {task.name for task in HEAVY}


def settings(name, story=IMPORTANCE, load=1.3):
    return division(name, story, tasks(load), tuned={task.name: 100 for task in HEAVY}).settings


@pytest.mark.parametrize("name", STATIC)
def test_static_divisions_know_no_context(name):
    first, *others = settings(name, SUSPENDING).values()
    assert set(first) == NAMES
    assert all(other == first for other in others)


def test_linux_default_sets_nothing():
    assert set(settings(DEFAULT)["drive"].values()) == {Setting()}


def test_requests_by_priority_are_all_of_the_processors():
    found = settings(PRIORITY)["drive"]
    assert sum(one.shares for one in found.values()) == pytest.approx(PROCESSORS * CORE, abs=len(found))
    assert found["nav"].shares > found["slam"].shares > found["map"].shares


def test_tuned_weights_use_the_search_result():
    assert {one.shares for one in settings(TUNED)["talk"].values()} == {100}


@pytest.mark.parametrize("context", SUSPENDING.contexts, ids=lambda context: context.name)
def test_suspension_alone_caps_what_its_context_suspends(context):
    found = settings(SUSPENSION, SUSPENDING)[context.name]
    assert {name: one for name, one in found.items() if one != Setting()} == dict.fromkeys(
        context.suspends, Setting(quota=STEP)
    )


def test_pinned_tasks_are_on_one_processor_each_and_both_are_used():
    places = [one.processors for one in settings(PINNED)["drive"].values()]
    assert all(len(place) == 1 for place in places)
    assert set().union(*places) == set(range(PROCESSORS))


def test_one_task_has_realtime_priority_throughout():
    found = settings(ROUND_ROBIN)["read"]
    assert [name for name, one in found.items() if one.realtime] == ["slam"]
    assert found["slam"].budget == REALTIME


@pytest.mark.parametrize("story", [IMPORTANCE, SUSPENDING])
def test_context_weights_favour_the_critical_task_of_each_context(story):
    for context in story.contexts:
        found = settings(WEIGHTS, story)[context.name]
        assert max(found, key=lambda name: found[name].shares) == context.critical
        assert all(one.quota is None for name, one in found.items() if name not in context.suspends)


def test_context_weights_compare_as_eq_1_and_add_up_to_the_processors():
    # 1900m over 100 + 10 + 3 + 3 + 3, with imu kept at its floor of 100m: to steps of 10m
    found = settings(WEIGHTS)["drive"]
    slam, other = 1900 * 100 / 119, 1900 * 3 / 119
    factor = PROCESSORS * 1000 / (slam + 3 * other + 2 * PROTECTED_WEIGHT)
    assert found["slam"].shares == pytest.approx(slam * factor * 1.024, abs=11)
    assert found["map"].shares == pytest.approx(other * factor * 1.024, abs=11)
    assert sum(one.shares for one in found.values()) == pytest.approx(PROCESSORS * CORE, abs=2 * len(found))


def test_a_protected_task_weighs_a_core_beside_the_others_however_small_its_share():
    found = settings(WEIGHTS)["drive"]
    assert found["nav"].shares == found["imu"].shares
    assert found["nav"].shares / found["slam"].shares == pytest.approx(PROTECTED_WEIGHT * 119 / 1900 / 100, rel=0.01)


def written(context, beside=0):
    """What the product writes for this robot, in shares by task; others request so much of its node."""
    effects = {
        task.name: {"suspend": True} if task.name in context.suspends else {"weight": WEIGHTED.weight(task, context)}
        for task in HEAVY
    }
    policy = a_policy(
        tasks=[
            a_task(task.name, protected=task.protected, min=f"{WEIGHTED.floor if task.protected else STEP}m")
            for task in HEAVY
        ],
        contexts=[a_context(context.name, "true", effects)],
        enforcement={"control": "Weight"},
    )
    pods = [view(a_pod(name, {name: cpu("10m", "2")})) for name in sorted(NAMES)]
    own = claim([policy], pods, {NODE: PROCESSORS * 1000}, agents={NODE}, weighing={NODE: beside})[policy.reference]
    made = message(policy, 1, Story(policy, own.placement).last, own.placement.containers, pods, own.most_weight)
    return {target["task"]: kubelet_shares(round(target["weight"] * 1000)) for target in made["targets"]}


@pytest.mark.parametrize("story", [IMPORTANCE, SUSPENDING])
def test_context_weights_are_what_the_product_writes_for_a_robot_alone_on_its_node(story):
    for context in story.contexts:
        found = {name: one.shares for name, one in settings(WEIGHTS, story)[context.name].items()}
        assert written(context) == pytest.approx(found, abs=11)


@pytest.mark.parametrize("story", [IMPORTANCE, SUSPENDING])
def test_context_weights_compare_as_those_that_the_product_writes_beside_other_pods(story):
    """Those of k3s and the operator: the robot's weights are all less by one factor, which its tasks can't notice."""
    for context in story.contexts:
        beside = {name: shares for name, shares in written(context, beside=400).items() if shares > LEAST_SHARES}
        alone = settings(WEIGHTS, story)[context.name]
        assert sum(beside.values()) <= (PROCESSORS * 1000 - 400) * 1.024
        assert {name: shares / 0.8 for name, shares in beside.items()} == pytest.approx(
            {name: alone[name].shares for name in beside}, abs=15
        )


@pytest.mark.parametrize("name", [WEIGHTS, *ATTEMPTS])
def test_a_suspended_task_has_the_least_weight_and_a_quota_but_for_one_attempt(name):
    quota = None if name.endswith("no quota") else STEP
    after = 0.0 if name.endswith(("quota", "at once", "ratio 10")) else 0.5
    assert settings(name, SUSPENDING)["drive"]["signs"] == Setting(LEAST_SHARES, quota=quota, after=after)


def test_context_limits_are_shares_of_at_most_a_core():
    for context in SUSPENDING.contexts:
        found = settings(LIMITS, SUSPENDING)[context.name]
        assert sum(one.quota for one in found.values()) == PROCESSORS * 1000
        assert max(one.quota for one in found.values()) == found[context.critical].quota == 1000
        assert all(found[name].quota == STEP for name in context.suspends)


def test_realtime_budgets_fit_in_what_the_kernel_leaves():
    for context in SUSPENDING.contexts:
        found = settings(BUDGETS, SUSPENDING)[context.name]
        assert set(found) == NAMES
        assert sum(one.budget for one in found.values()) == REALTIME
        assert {name for name, one in found.items() if not one.realtime} == context.suspends
        assert all(one.budget > 0 for one in found.values()), "a group with realtime threads can't have none"


def test_contention_only_weights_are_equal_at_light_load():
    name = "weights, only above 0.8"
    assert {one.shares for one in settings(name, load=0.7)["drive"].values()} == {CORE}
    assert settings(name, load=1.3) == settings(WEIGHTS, load=1.3)


def test_floor_weights_cover_each_tasks_demand_at_light_load():
    light = settings("weights, floors at need", load=0.7)["drive"]
    for task in tasks(0.7):
        assert light[task.name].shares >= kubelet_shares(round(task.wants * 1000) - STEP)
    assert settings("weights, floors at need", load=1.3) == settings(WEIGHTS, load=1.3)


def test_an_attempt_gives_the_protected_short_slices():
    found = settings("weights, slice 0.5 ms")["talk"]
    assert {name for name, one in found.items() if one.slice} == {"nav", "imu"}
