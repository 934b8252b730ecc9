"""The order of writes, against a model of the kernel's rules."""

from __future__ import annotations

from math import inf
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.agent.steps import LimitStep, PodLimits, budget_steps, budgets, limit_steps

POD, OTHER = Path("/top/pod1"), Path("/top/pod2")
A, B, C = POD / "a", POD / "b", OTHER / "c"
TOP = Path("/top")
SHARE = st.integers(1, 950)
LIMIT = st.none() | SHARE
"""None is no limit."""


def test_decreases_come_first_and_a_pod_grows_ahead_of_its_containers():
    pods = [PodLimits(POD, 500, 0, {A: (500, 900)}), PodLimits(OTHER, 500, 0, {C: (500, 100)})]
    assert limit_steps(pods) == [LimitStep(C, 100), LimitStep(POD, 900), LimitStep(A, 900)]


def test_a_pod_is_the_sum_of_its_containers():
    assert limit_steps([PodLimits(POD, 400, 100, {A: (100, 200), B: (200, 250)})]) == [
        LimitStep(POD, 550),
        LimitStep(A, 200),
        LimitStep(B, 250),
    ]


def test_a_pod_without_limit_stays_so():
    assert limit_steps([PodLimits(POD, None, 0, {A: (100, 200)})]) == [LimitStep(A, 200)]


def test_a_container_without_limit_gets_one_among_the_decreases():
    pods = [PodLimits(OTHER, 500, 0, {C: (400, 500)}), PodLimits(POD, None, 0, {A: (None, 200)})]
    assert limit_steps(pods) == [LimitStep(A, 200), LimitStep(C, 500)]


def test_removing_a_container_limit_removes_the_pods_first():
    pods = [PodLimits(POD, 500, 100, {A: (400, None)})]
    assert limit_steps(pods) == [LimitStep(POD, None), LimitStep(A, None)]


def test_correct_values_are_not_rewritten():
    assert limit_steps([PodLimits(POD, 500, 0, {A: (500, 500)})]) == []


@given(st.lists(st.tuples(LIMIT, LIMIT), min_size=1, max_size=6), st.integers(0, 300))
def test_no_step_breaks_a_pod_limit_or_exceeds_the_larger_sum(shares, others):
    containers = {POD / str(number): pair for number, pair in enumerate(shares)}
    now = {group: before for group, (before, _) in containers.items()}
    pod = None if None in now.values() else sum(now.values()) + others
    most = max(total(now), total({group: wanted for group, (_, wanted) in containers.items()}))
    for step in limit_steps([PodLimits(POD, pod, others, containers)]):
        if step.group == POD:
            pod = step.amount
        else:
            now[step.group] = step.amount
        assert all(total({POD: limit}) <= total({POD: pod}) for limit in now.values())
        assert total(now) <= most
    assert now == {group: wanted for group, (_, wanted) in containers.items()}
    assert total(now) + others <= total({POD: pod})


def total(limits):
    return inf if None in limits.values() else sum(limits.values())


def test_group_budget_is_the_sum_of_its_children():
    qos = TOP / "burstable"
    leaves = {qos / "pod1" / "a": 100, qos / "pod1" / "b": 50, TOP / "pod3" / "c": 200}
    assert budgets(leaves, TOP, {}, {}) == leaves | {qos / "pod1": 150, qos: 150, TOP / "pod3": 200, TOP: 350}


def test_group_keeps_its_own_and_external_budgets():
    assert budgets({A: 100}, TOP, {POD: 30}, {TOP: 400})[POD] == 130
    assert budgets({A: 100}, TOP, {POD: 30}, {TOP: 400})[TOP] == 400


LEAF = st.sampled_from([TOP / "q" / f"p{pod}" / f"c{number}" for pod in "12" for number in "12"] + [TOP / "g" / "c"])
BUDGETS = st.dictionaries(LEAF, st.integers(0, 190), min_size=1)


@given(BUDGETS, BUDGETS)
def test_at_no_instant_have_children_more_than_their_parent(before, after):
    leaves = dict.fromkeys(before, 0) | after
    now = dict.fromkeys(budgets(leaves, TOP, {}, {}), 0) | budgets(before, TOP, {}, {})
    most = max(sum(before.values()), sum(after.values()))
    wanted = budgets(leaves, TOP, {}, {})
    for step in budget_steps(now, wanted):
        now[step.group] = step.amount
        for parent in {group.parent for group in now if group != TOP}:
            assert sum(amount for group, amount in now.items() if group.parent == parent) <= now[parent]
        assert now[TOP] <= most
    assert now == wanted
