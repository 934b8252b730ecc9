"""The order of writes, against a model of the kernel's rules."""

from __future__ import annotations

from math import inf
from pathlib import Path

from hypothesis import assume, given
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


def test_a_container_without_limit_has_that_of_its_pod():
    """The kubelet limits such a pod only if it has a limit of its own."""
    assert limit_steps([PodLimits(POD, 500, 100, {A: (400, None), B: (50, 600)})]) == [
        LimitStep(A, 500),
        LimitStep(B, 500),
    ]


def test_containers_without_limit_that_the_driver_has_rounded_otherwise_are_left():
    assert limit_steps([PodLimits(POD, 420, 0, {A: (417, None)})]) == []


def test_a_pod_with_a_limit_of_its_own_keeps_it_and_its_containers_are_within():
    pods = [PodLimits(POD, 600, 300, {A: (300, 990), B: (200, 100)}, owned=True)]
    assert limit_steps(pods) == [LimitStep(B, 100), LimitStep(A, 600)]


def test_an_unenforced_limit_of_a_pod_bounds_nothing():
    pods = [PodLimits(POD, None, 0, {A: (300, 990), B: (300, None)}, owned=True)]
    assert limit_steps(pods) == [LimitStep(A, 990), LimitStep(B, None)]


def test_correct_values_are_not_rewritten():
    assert limit_steps([PodLimits(POD, 500, 0, {A: (500, 500)})]) == []


@given(st.lists(st.tuples(LIMIT, LIMIT), min_size=1, max_size=6), st.integers(0, 300))
def test_no_step_breaks_a_pod_limit_or_exceeds_the_larger_sum(shares, others):
    containers = {POD / str(number): pair for number, pair in enumerate(shares)}
    now = {group: before for group, (before, _) in containers.items()}
    pod = None if None in now.values() else sum(now.values()) + others
    assume(pod is None or None not in [wanted for _, wanted in shares])
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


@given(st.lists(st.tuples(LIMIT, LIMIT), min_size=1, max_size=6), st.integers(0, 300), LIMIT)
def test_a_pod_with_a_limit_of_its_own_is_never_written_nor_exceeded(shares, others, pod):
    now = {POD / str(number): before for number, (before, _) in enumerate(shares)}
    wanted = {POD / str(number): after for number, (_, after) in enumerate(shares)}
    containers = {group: (now[group], wanted[group]) for group in now}
    for step in limit_steps([PodLimits(POD, pod, others, containers, owned=True)]):
        assert step.group in now
        assert total({POD: step.amount}) <= total({POD: pod})
        now[step.group] = step.amount
    for group, limit in wanted.items():
        least = min(total({POD: limit}), total({POD: pod}))
        assert least - 10 < total({POD: now[group]}) <= least or now[group] == limit


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
