"""Which orders are obeyed."""

from __future__ import annotations

import pytest

from contextpolicy.agent.admission import REPEATABLE, Admission
from contextpolicy.agent.node_orders import read
from contextpolicy.errors import OrderError
from tests.agent.builders import CHAT, NODE, POLICY, SLAM, SPEECH, TIMES, a_message, a_target

OTHER = "robot/other"


def an_order(*targets, policy=POLICY, **more):
    return read(a_message(*targets, policy=policy, **more), policy, NODE)


class Listening(Admission):
    """Hears messages that were signed one after the other, unless a test says when."""

    def admit(self, order, signed=None):
        return super().admit(order, next(TIMES) if signed is None else signed)


@pytest.fixture
def admission():
    return Listening(cpus=lambda: 2)


def refusal(admission, order):
    with pytest.raises(OrderError) as caught:
        admission.admit(order)
    return caught.value.reason


@pytest.mark.parametrize("later", [{"sequence": 3}, {"sequence": 1, "run": 2}])
def test_orders_move_forward(admission, later):
    assert admission.admit(an_order(sequence=2))
    assert admission.admit(an_order(**later))
    assert refusal(admission, an_order(sequence=2)) == "Outdated"


def test_repeated_order_is_ignored(admission):
    assert admission.admit(an_order(sequence=2))
    assert admission.admit(an_order(sequence=2)) is None


def test_edition_counts_only_if_its_targets_differ(admission):
    assert admission.admit(an_order(a_target(), sequence=2))
    assert admission.admit(an_order(a_target(limit=0.5), sequence=2, edition=1)) is None
    assert admission.admit(an_order(a_target(SPEECH), sequence=2, edition=2))
    assert refusal(admission, an_order(a_target(), sequence=2, edition=1)) == "Outdated"


def test_an_edition_after_a_policy_was_dropped_is_obeyed(admission):
    assert admission.admit(an_order(a_target(), sequence=2))
    admission.drop(POLICY)
    assert admission.admit(an_order(a_target(), sequence=2, edition=1))


def test_each_policy_counts_for_itself(admission):
    assert admission.admit(an_order(sequence=9))
    assert admission.admit(an_order(sequence=1, policy=OTHER))


def test_a_new_source_starts_a_new_count(admission):
    admission.admit(an_order(run=9))
    admission.lose_source(POLICY)
    assert admission.admit(an_order(run=8))
    assert refusal(admission, an_order(run=7)) == "Outdated"


def test_the_same_source_continues_where_it_was(admission):
    admission.admit(an_order(sequence=5))
    admission.lose_source(POLICY)
    assert admission.admit(an_order(sequence=5)) is None
    assert refusal(admission, an_order(sequence=4)) == "Outdated"


def test_order_in_flight_when_its_policy_is_dropped_is_ignored(admission):
    admission.admit(an_order(sequence=5))
    admission.lose_source(POLICY)
    admission.drop(POLICY)
    assert admission.admit(an_order(sequence=5)) is None


def test_forgotten_policy_may_repeat_its_sequence(admission):
    admission.admit(an_order(sequence=5))
    admission.forget(POLICY)
    assert admission.admit(an_order(sequence=5))


def test_a_refused_order_does_not_count(admission):
    assert refusal(admission, an_order(a_target(cores=1.5), sequence=5)) == "TooMuch"
    assert admission.admit(an_order(a_target(), sequence=2))


@pytest.mark.parametrize(
    ("cores", "capacity", "scheduler"),
    [
        ((0.6, 0.5), 1.0, "CFS"),
        ((1.1,), 1.0, "CFS"),
        ((0.5,), 2.5, "CFS"),
        ((1.0, 0.902), 1.9, "Realtime"),
        ((1.0,), 1.902, "Realtime"),
        ((1.0, 0.5), 1.4, "Realtime"),
    ],
)
def test_order_beyond_the_capacity_is_refused(admission, cores, capacity, scheduler):
    targets = [a_target(identity, share) for identity, share in zip((SLAM, SPEECH), cores, strict=False)]
    assert refusal(admission, an_order(*targets, capacity=capacity, scheduler=scheduler)) == "TooMuch"


def test_realtime_budgets_of_all_policies_fit_the_period(admission):
    realtime = {"scheduler": "Realtime", "capacity": 1.9}
    assert admission.admit(an_order(a_target(SLAM, 1.0), **realtime))
    assert refusal(admission, an_order(a_target(SPEECH, 0.902), policy=OTHER, **realtime)) == "TooMuch"
    assert admission.admit(an_order(a_target(SPEECH, 0.9), policy=OTHER, **realtime))


def test_realtime_budgets_are_whole_parts_of_the_period_of_each_processor(admission):
    realtime = {"scheduler": "Realtime", "capacity": 1.9}
    assert refusal(admission, an_order(a_target(SLAM, 0.501), **realtime)) == "Unreadable"
    assert admission.admit(an_order(a_target(SLAM, 0.501)))


def test_a_container_of_another_policy_is_not_touched(admission):
    admission.admit(an_order(a_target(SLAM)))
    assert refusal(admission, an_order(a_target(SLAM), policy=OTHER)) == "Owned"
    admission.drop(POLICY)
    assert admission.admit(an_order(a_target(SLAM), policy=OTHER))


def test_duplicate_container_is_refused(admission):
    assert refusal(admission, an_order(a_target(CHAT, 0.1), a_target(CHAT, 0.2))) == "Twice"


def test_containers_that_start_are_not_mistaken_for_each_other(admission):
    starting = a_target(SLAM, containerId="")
    assert admission.admit(an_order(starting, starting))
    assert admission.admit(an_order(starting, policy=OTHER))


@pytest.mark.parametrize("changes", [{"mode": "DryRun"}, {"mode": "Paused"}])
def test_dry_run_and_paused_orders_have_no_targets(admission, changes):
    admitted = admission.admit(an_order(a_target(), **changes))
    assert admitted is not None
    assert admitted.targets == ()


def test_a_plan_of_a_former_source_is_not_admitted_again(admission):
    """A listener can replay it when the source is gone, or the policy is forgotten: it is still signed."""
    for leave in (admission.lose_source, admission.forget):
        first, second = next(TIMES), next(TIMES)
        admission.admit(an_order(run=1), first)
        admission.admit(an_order(run=2), second)
        leave(POLICY)
        with pytest.raises(OrderError, match="before the latest plan accepted"):
            admission.admit(an_order(run=1), first)
        admission.forget(POLICY)


def test_the_last_plan_of_a_forgotten_policy_is_not_admitted_again(admission):
    at = next(TIMES)
    assert admission.admit(an_order(a_target()), at)
    admission.forget(POLICY)
    with pytest.raises(OrderError, match=r"0\.000 s before the latest plan accepted"):
        admission.admit(an_order(a_target()), at)
    assert admission.admit(an_order(a_target()), at + 1)


def test_only_replay_protection_outlives_a_policy(admission):
    for number in range(9):
        policy = f"robot/policy{number}"
        admission.admit(an_order(policy=policy), (number + 1) * REPEATABLE)
        admission.lose_source(policy)
        admission.forget(policy)
        for recent in (policy, f"robot/policy{max(0, number - 1)}"):
            with pytest.raises(OrderError, match="before the latest plan accepted"):
                admission.admit(an_order(policy=recent), max(1, number) * REPEATABLE)
    remembered = [known for known in vars(admission).values() if isinstance(known, dict | set)]
    assert max(len(known) for known in remembered) <= 2


def test_a_withdrawal_counts_only_after_the_plan_that_it_withdraws(admission):
    first, second, third = next(TIMES), next(TIMES), next(TIMES)
    admission.admit(an_order(), second)
    for too_early in (first, second, second - REPEATABLE - 1):
        with pytest.raises(OrderError, match="before the latest plan accepted"):
            admission.withdraw(POLICY, too_early)
    admission.withdraw(POLICY, third)


def test_a_withdrawn_policy_has_no_containers_any_more(admission):
    admission.admit(an_order(a_target(SLAM)))
    admission.withdraw(POLICY, next(TIMES))
    assert admission.admit(an_order(a_target(SLAM), policy=OTHER))


def test_clock_set_back_does_not_lock_out_new_orders(admission):
    """Messages signed that far apart do not both pass for fresh, unless the clock was set."""
    now = next(TIMES)
    admission.admit(an_order(run=5), now)
    admission.lose_source(POLICY)
    with pytest.raises(OrderError, match=r"20\.000 s before the latest plan accepted"):
        admission.admit(an_order(run=4), now - REPEATABLE)
    assert admission.admit(an_order(run=4), now - REPEATABLE - 1)


def test_an_order_that_failed_is_obeyed_again_until_it_succeeds(admission):
    order = an_order(a_target())
    for _ in range(2):
        assert admission.admit(order)
        admission.fail(POLICY)
    assert refusal(admission, an_order(a_target(), run=0)) == "Outdated"
    assert admission.admit(an_order(a_target(), edition=1))
    assert admission.admit(an_order(a_target(), edition=2)) is None


def test_an_order_that_failed_still_has_its_containers(admission):
    admission.admit(an_order(a_target(SLAM)))
    admission.fail(POLICY)
    assert refusal(admission, an_order(a_target(SLAM), policy=OTHER)) == "Owned"


def test_an_order_that_failed_is_not_obeyed_again_once_its_policy_is_gone(admission):
    admission.admit(an_order(a_target()))
    admission.fail(POLICY)
    admission.withdraw(POLICY, next(TIMES))
    assert admission.admit(an_order(a_target())) is None
