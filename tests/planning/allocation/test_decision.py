"""Whole decisions: whose needs are met and who yields for it, and what holds for every policy."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.planning.allocation.decision import Decider, Situation
from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.planning.allocation.seating import seat_tasks
from tests.planning.builders import Story, a_context, a_parent, a_policy, a_task, on_node


def shares(*tasks, cores=2, **spec):
    return Story(a_policy(tasks=list(tasks), **spec), on_node(*(t["name"] for t in tasks), cores=cores)).shares()


def yielding(name, cores, **fields):
    return a_task(name, needs={"cores": cores, "enforce": "Suspend"}, **fields)


class TestNeedsThatDecide:
    def test_by_default_a_task_is_kept_and_reported(self):
        story = Story(a_policy(tasks=[a_task("slam", needs={"cores": 2}), a_task("rest")]))
        assert story.shares() == {"slam": 500, "rest": 500}
        assert [shortfall.message for shortfall in story.last.shortfalls] == ["needs 2 cores, but gets 500m"]

    def test_a_task_that_yields_leaves_its_share_to_the_others(self):
        story = Story(a_policy(tasks=[yielding("slam", 2), a_task("rest")]))
        assert story.shares() == {"slam": 10, "rest": 990}
        slam = story.last.tasks["slam"]
        assert slam.suspended
        assert slam.because == "yields to the others: it needs 2 cores, but gets 500m"
        assert [s.message for s in story.last.shortfalls] == ["is suspended: it needs 2 cores, but gets 500m"]

    def test_the_lightest_yields_first_and_that_may_be_enough(self):
        got = shares(yielding("heavy", 1, priority=3), yielding("light", 1), a_task("rest", priority=3))
        assert got == {"heavy": 1000, "light": 10, "rest": 990}

    def test_equal_weights_yield_in_list_order(self):
        assert shares(yielding("b", 1.5), yielding("a", 1.5)) == {"b": 10, "a": 1990}

    def test_one_after_the_other_yields_until_the_rest_is_met(self):
        got = shares(*(yielding(name, 1.5, priority=p) for name, p in (("a", 2), ("b", 1), ("c", 3))))
        assert got == {"a": 10, "b": 10, "c": 1980}

    def test_a_task_comes_back_when_a_heavier_one_cannot_be_met_in_any_case(self):
        """`light` alone can be met: yielding to `heavy` would help no task."""
        got = shares(yielding("light", 1), yielding("heavy", 8, priority=9))
        assert got == {"light": 1990, "heavy": 10}

    def test_a_compound_yields_as_a_whole(self):
        policy = a_policy(
            tasks=[
                a_parent("speech", "keyword", "transcript"),
                yielding("keyword", 2),
                a_task("transcript"),
                a_task("x"),
            ]
        )
        story = Story(policy)
        assert {name: task.share for name, task in story.last.tasks.items()}["x"] == 980
        assert story.last.tasks["transcript"].suspended

    def test_the_decision_does_not_depend_on_history(self):
        policy = a_policy(tasks=[yielding("slam", 1), a_task("rest")])
        story = Story(policy, on_node("slam", "rest", cores=2))
        story.place(on_node("slam", "rest", cores=1), at=1)
        assert story.last.tasks["slam"].suspended
        story.place(on_node("slam", "rest", cores=2), at=2)
        assert story.shares() == {"slam": 1000, "rest": 1000}


class TestProtected:
    OFF = a_context("off", tasks={"brake": {"suspend": True}, "stop": {"suspend": True}})

    def test_it_keeps_its_min_when_its_parent_is_forced_off(self):
        policy = a_policy(
            tasks=[
                a_parent("stop", "brake", "horn"),
                a_task("brake", min="400m", protected=True, priority=0.1),
                a_task("horn", min="300m"),
                a_task("rest", priority=99),
            ],
            contexts=[self.OFF],
            force={"context": "off", "until": "2100-01-01T00:00:00Z"},
        )
        story = Story(policy, on_node("brake", "horn", "rest", cores=2))
        assert story.last.contexts == ("off",)
        assert story.shares() == {"stop": 0, "brake": 400, "horn": 10, "rest": 1590}
        assert not story.last.tasks["brake"].suspended

    def test_it_is_suspended_when_it_cannot_run(self):
        tasks = [a_task("brake", min="400m", protected=True, requires=[{"when": "false"}]), a_task("rest")]
        story = Story(a_policy(tasks=tasks))
        assert story.last.tasks["brake"].suspended
        assert story.shares() == {"brake": 400, "rest": 600}


def suspended(story):
    return {name for name, task in story.last.tasks.items() if task.suspended}


def test_a_group_is_suspended_with_the_last_of_its_parts():
    tasks = [a_parent("talk", "hear", satisfiedBy="Any"), a_parent("hear", "keyword", "noise", satisfiedBy="Any")]
    leaves = [a_task("keyword"), a_task("noise"), a_task("rest")]

    def off(*names):
        context = a_context("off", tasks={name: {"suspend": True} for name in names})
        force = {"context": "off", "until": "2100-01-01T00:00:00Z"}
        return suspended(Story(a_policy(tasks=[*tasks, *leaves], contexts=[context], force=force)))

    assert off("keyword") == {"keyword"}
    assert off("keyword", "noise") == {"keyword", "noise", "hear", "talk"}


def test_a_new_weight_shows_although_no_share_changes():
    policy = a_policy(tasks=[a_task("slam"), a_task("rest")])
    decider, seating = Decider(policy), seat_tasks(policy, on_node("slam", "rest"))
    for score in (1.0, 2.0, 3.0):
        situation = Situation({"slam": score, "rest": score}, {}, (), seating, {})
        assert decider.decide(situation).tasks == Decider(policy).decide(situation).tasks


@pytest.mark.parametrize("placement", [on_node("slam", "rest", cores=4), on_node("slam", "rest", request=900, cores=2)])
def test_a_new_placement_is_decided_as_if_it_were_the_first(placement):
    policy = a_policy(tasks=[a_task("slam", priority=9), a_task("rest")])
    decider = Decider(policy)
    for place in (on_node("slam", "rest"), placement):
        situation = Situation({"slam": 1.0, "rest": 1.0}, {}, (), seat_tasks(policy, place), {})
        decision = decider.decide(situation)
    assert decision.division == Decider(policy).decide(situation).division


EFFECTS = st.sampled_from([{"suspend": True}, {"weight": 0}, {"scale": 0}, {"scale": 0.5}, {"weight": 3}])


@st.composite
def situations(draw):
    """A tree of tasks with bounds, needs, contexts, unmet pre-conditions and missing pods, on a node of some size."""
    count = draw(st.integers(2, 9))
    names = [f"t{at}" for at in range(count)]
    parents: dict[str, list[str]] = {}
    for at, name in enumerate(names[1:], 1):
        if draw(st.booleans()):
            parents.setdefault(names[draw(st.integers(0, at - 1))], []).append(name)
    tasks = []
    for name in names:
        priority = draw(st.sampled_from([0, 0.5, 1, 1, 7]))
        if name in parents:
            kind = draw(st.sampled_from(["All", "Any"]))
            tasks.append(a_parent(name, *parents[name], priority=priority, satisfiedBy=kind))
            continue
        fields = {"priority": priority, "min": f"{draw(st.integers(1, 40))}0m", "protected": draw(st.booleans())}
        if not fields["protected"] and draw(st.booleans()):
            fields["needs"] = {"cores": f"{draw(st.integers(1, 150))}0m", "enforce": "Suspend"}
        tasks.append(a_task(name, **fields))
    effects = draw(st.dictionaries(st.sampled_from(names), EFFECTS, max_size=count))
    policy = a_policy(tasks=tasks, contexts=[a_context("c", tasks=effects)], enforcement={"control": "Weight"})
    leaves = [task.name for task in policy.leaves]
    some = st.sets(st.sampled_from(leaves))
    absent = frozenset(draw(some))
    containers = tuple(Container(name, name, "robot") for name in leaves if name not in absent)
    placement = Placement({"robot": draw(st.integers(max(1, len(containers)), 300)) * 10}, containers, absent=absent)
    scores = {name: draw(st.sampled_from([0.0, 0.3, 1.0, 1.0])) for name in names}
    active = policy.contexts if draw(st.booleans()) else ()
    situation = Situation(scores, dict.fromkeys(draw(some), "x"), active, seat_tasks(policy, placement), {})
    return policy, placement, situation


def decided(policy, situation):
    return Decider(policy).decide(situation)


@given(situations())
def test_shares_sum_to_the_node_or_to_the_least_of_all(case):
    policy, placement, situation = case
    node = decided(policy, situation).division.nodes.get("robot")
    if node is None:
        assert not placement.containers
        return
    total = sum(node.shares.values())
    if node.basis == "Nothing":
        floors = {t.name: t.min if t.protected else 10 for t in policy.leaves}
        assert total == min(node.capacity, sum(floors[name] for name in node.shares))
    else:
        assert total == node.capacity


@given(situations())
def test_a_protected_task_is_never_below_its_min_nor_suspended_by_others(case):
    policy, placement, situation = case
    decision = decided(policy, situation)
    protected = [task for task in policy.leaves if task.protected]
    running = {container.task for container in placement.containers}
    promised = sum(task.min if task.protected else 10 for task in policy.leaves if task.name in running)
    for task in protected:
        if task.name in running and promised <= placement.allocatable["robot"]:
            assert decision.division.shares[task.name] >= task.min
        if task.name in running and task.name not in situation.waiting:
            assert not decision.tasks[task.name].suspended


@given(situations(), st.randoms(use_true_random=False))
def test_the_order_of_tasks_decides_nothing_but_ties(case, rng):
    """Needs are left out: there the order in the list settles ties by design."""
    policy, placement, situation = case
    weights = Decider(policy)._attempt(situation, {}).weights
    shuffled = list(policy.tasks)
    rng.shuffle(shuffled)
    other = type(policy)(
        policy.namespace, policy.name, tuple(shuffled), contexts=policy.contexts, enforcement=policy.enforcement
    )
    again = Decider(other)._attempt(situation._replace(layout=seat_tasks(other, placement)), {})
    assert {name: w.able for name, w in again.weights.items()} == {name: w.able for name, w in weights.items()}
    assert {name: w.value for name, w in again.weights.items()} == pytest.approx(
        {name: w.value for name, w in weights.items()}
    )


@given(situations())
def test_in_the_end_every_need_that_may_decide_is_met(case):
    policy, _, situation = case
    decision = decided(policy, situation)
    enforced = {task.name: task.needs.cores for task in policy.leaves if task.needs.enforce == "Suspend"}
    for name, cores in enforced.items():
        if cores is not None and decision.weights[name].value > 0 and name in decision.division.shares:
            assert decision.division.shares[name] >= cores


@given(situations())
def test_a_weight_is_split_and_never_lost(case):
    """The leaves' weights sum to what the roots weigh, but for protected ones that go on without their parents."""
    policy, _, situation = case
    weights = decided(policy, situation).weights
    below = {name for task in policy.tasks for name in task.subtasks}
    roots = sum(weights[task.name].value for task in policy.tasks if task.name not in below)
    alone = sum(weights[t.name].value for t in policy.leaves if weights[t.name].because.startswith("protected"))
    leaves = sum(weights[task.name].value for task in policy.leaves)
    assert leaves == pytest.approx(roots + alone)
