"""What each division writes for each task in each context."""

import pytest

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
from tests.bench.enforcement.policy import ATTEMPTS, STEP
from tests.bench.enforcement.stories import IMPORTANCE, PROCESSORS, SUSPENDING, tasks

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


def test_context_weights_are_eq_1_in_the_kubelets_unit():
    # 1900m over 100 + 10 + 3 + 3 + 3, with imu kept at its floor of 100m: to steps of 10m
    found = settings(WEIGHTS)["drive"]
    assert found["slam"].shares == pytest.approx(1900 * 100 / 119 * 1.024, abs=11)
    assert found["map"].shares == pytest.approx(1900 * 3 / 119 * 1.024, abs=11)


def test_a_protected_task_weighs_a_core_however_small_its_share():
    found = settings(WEIGHTS)["drive"]
    assert found["nav"].shares == found["imu"].shares == kubelet_shares(PROTECTED_WEIGHT) == 1024


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
