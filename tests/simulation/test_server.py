"""Properties of the node's model, and cases that can be worked out by hand."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contextpolicy.simulation.server import Allowance, Change, Fate, Server, Work, Worker

PERIOD = 0.1
END = 250.0
TASKS = ("a", "b", "c")

works = st.lists(
    st.builds(
        Work,
        at=st.floats(0, 20, allow_nan=False),
        task=st.sampled_from(TASKS),
        input=st.just(0),
        cpu=st.floats(0, 0.5, allow_nan=False),
        transit=st.just(0.0),
    ),
    max_size=40,
).map(sorted)
shares = st.sampled_from([0.01, 0.05, 0.3, 0.99, 1.0, 1.5])


def serve(arrivals, changes=(), *, cores=2.0, depths=1000, threads=1.0, until=END, background=0.0):  # noqa: PLR0913
    workers = {task: Worker([depths, depths], threads, background) for task in TASKS}
    server = Server(cores, workers, PERIOD)
    server.serve(arrivals, list(changes), until)
    return server


def quota(**cores):
    return Change(0.0, {task: Allowance(1.0, share) for task, share in cores.items()})


def responses(server, task="a"):
    done = [one for one in server.outcomes if one.work.task == task and one.fate is Fate.DONE]
    return [one.response for one in sorted(done, key=lambda one: one.work)]


def test_transport_delay_adds_to_the_response_time():
    assert responses(serve([Work(1.0, "a", 0, 0.25, 0.1), Work(1.1, "a", 0, 0.25)])) == pytest.approx([0.35, 0.4])


def test_a_quota_stops_a_task_for_the_rest_of_each_period():
    """0.25 CPU seconds at 30 ms in each 100 ms: eight full periods, then 10 ms of the ninth."""
    server = serve([Work(0.0, "a", 0, 0.25)], [quota(a=0.3)])
    assert responses(server) == pytest.approx([8 * PERIOD + 0.01])


def test_a_task_arriving_mid_period_has_its_full_quota():
    assert responses(serve([Work(0.05, "a", 0, 0.04)], [quota(a=0.3)])) == pytest.approx([0.03 + 0.02 + 0.01])


def test_periods_may_start_before_time_zero():
    """60 ms are left of the first period: its 30 ms, then 10 of the next."""
    server = Server(2.0, {"a": Worker([1])}, PERIOD, offset=0.04)
    server.serve([Work(0.0, "a", 0, 0.04)], [quota(a=0.3)], END)
    assert responses(server) == pytest.approx([0.06 + 0.01])


def test_a_quota_is_refilled_after_idle_periods():
    server = serve([Work(0.0, "a", 0, 0.03), Work(5.05, "a", 0, 0.03)], [quota(a=0.3)])
    assert responses(server) == pytest.approx([0.03, 0.03])


def test_threads_use_several_cores_and_their_quota_faster():
    assert responses(serve([Work(0.0, "a", 0, 0.4)], threads=2.0)) == pytest.approx([0.2])
    assert responses(serve([Work(0.0, "a", 0, 0.2)], [quota(a=1.0)], threads=2.0)) == pytest.approx([0.1 + 0.05])


def test_tasks_that_compete_divide_the_node_by_weight():
    weights = Change(0.0, {"a": Allowance(3.0), "b": Allowance(1.0)})
    server = serve([Work(0.0, "a", 0, 0.3), Work(0.0, "b", 0, 0.3)], [weights], cores=1.0)
    assert responses(server, "a") == pytest.approx([0.4])
    assert responses(server, "b") == pytest.approx([0.6])


def test_unused_cpu_goes_to_other_tasks():
    weights = Change(0.0, {"a": Allowance(100.0), "b": Allowance(1.0), "c": Allowance(1.0)})
    server = serve([Work(0.0, task, 0, 0.2) for task in TASKS], [weights], cores=2.0)
    assert responses(server, "a") == pytest.approx([0.2])
    assert responses(server, "b") == pytest.approx([0.3])


def test_a_full_queue_drops_its_oldest_and_only_that_queue():
    arrivals = [Work(0.0, "a", 0, 1.0), *(Work(0.1 * n, "a", 0, 0.1) for n in (1, 2, 3)), Work(0.35, "a", 1, 0.1)]
    server = serve(arrivals, depths=1)
    assert [(one.work.at, one.fate) for one in sorted(server.outcomes) if one.fate is Fate.DROPPED] == [
        (0.1, Fate.DROPPED),
        (0.2, Fate.DROPPED),
    ]
    assert len(responses(server)) == 3


def test_a_suspended_task_takes_no_input_and_forgets_those_that_wait():
    suspended = Change(0.5, {"a": Allowance(1.0, 0.01, suspended=True)})
    freed = Change(1.0, {"a": Allowance(1.0, 1.0)})
    arrivals = [Work(0.0, "a", 0, 0.6), Work(0.1, "a", 0, 0.1), Work(0.7, "a", 0, 0.1), Work(1.5, "a", 0, 0.1)]
    server = serve(arrivals, [suspended, freed])
    fates = {one.work.at: one.fate for one in server.outcomes}
    assert fates == {0.0: Fate.DONE, 0.1: Fate.SUSPENDED, 0.7: Fate.SUSPENDED, 1.5: Fate.DONE}


def test_a_change_of_quota_counts_at_once():
    """50 ms at 0.1 cores: 10 ms are done, then the new quota refills in the middle of the period."""
    server = serve([Work(0.0, "a", 0, 0.05)], [quota(a=0.1), Change(0.03, {"a": Allowance(1.0, 1.0)})])
    assert responses(server) == pytest.approx([0.07])


def test_the_background_is_taken_off_quota_and_node():
    server = serve([Work(0.0, "a", 0, 0.06)], [quota(a=0.5)], background=0.2)
    assert responses(server) == pytest.approx([0.1 + 0.03])
    assert responses(serve([Work(0.0, "a", 0, 0.1)], cores=1.1, background=0.2)) == pytest.approx([0.2])


def test_inputs_pending_at_the_end_are_unfinished():
    server = serve([Work(0.0, "a", 0, 5.0), Work(0.5, "a", 0, 0.1)], until=1.0)
    assert [(one.fate, one.response) for one in server.outcomes] == [(Fate.UNFINISHED, 1.0), (Fate.UNFINISHED, 0.5)]


@settings(max_examples=50)
@given(works)
def test_without_quotas_the_queue_is_lindleys(arrivals):
    """One task alone: each input waits for those before it, and nothing else (Lindley's recursion)."""
    own = [work for work in arrivals if work.task == "a"]
    expected, free = [], 0.0
    for work in own:
        free = max(free, work.at) + work.cpu
        expected.append(free - work.at)
    assert responses(serve(own)) == pytest.approx(expected, abs=1e-6)


@settings(max_examples=50)
@given(works, st.tuples(shares, shares, shares), st.sampled_from([1, 3, 1000]), st.sampled_from([0.5, 2.0]))
def test_every_input_has_one_fate_and_no_time_is_negative(arrivals, parts, depth, cores):
    server = serve(arrivals, [quota(**dict(zip(TASKS, parts, strict=True)))], depths=depth, cores=cores)
    assert sorted(one.work for one in server.outcomes) == arrivals
    for one in server.outcomes:
        least = 0.0 if one.fate is Fate.DROPPED else one.work.cpu
        assert one.response >= least - 1e-6
        assert one.queue >= 0


@settings(max_examples=50)
@given(works, shares, shares, shares)
def test_usage_never_exceeds_node_or_quota(arrivals, a, b, c):
    server = serve(arrivals, [quota(a=a, b=b, c=c)])
    assert all(stretch.cores <= 2.0 + 1e-9 and stretch.end >= stretch.start for stretch in server.used)
    for task, share in zip(TASKS, (a, b, c), strict=True):
        mine = [one for one in server.outcomes if one.work.task == task and one.fate is Fate.DONE]
        for one in mine:
            periods = math.floor((one.work.at + one.response) / PERIOD + 1e-6) - math.floor(one.work.at / PERIOD) + 1
            assert one.work.cpu <= share * PERIOD * periods + 1e-6


@settings(max_examples=50)
@given(works, st.sampled_from([0.5, 1.0, 2.0]))
def test_it_is_work_conserving(arrivals, cores):
    """Without quotas the node never idles while a task has work that it could do: the last is done in time."""
    server = serve(arrivals, cores=cores)
    total = sum(work.cpu for work in arrivals)
    assert sum((stretch.end - stretch.start) * stretch.cores for stretch in server.used) == pytest.approx(
        total, abs=1e-5
    )
    assert all(one.fate is Fate.DONE for one in server.outcomes)
    finish = max((one.work.at + one.response for one in server.outcomes), default=0.0)
    latest = max((work.at for work in arrivals), default=0.0)
    assert finish <= latest + total / min(1.0, cores) + 1e-6


@settings(max_examples=50)
@given(works, shares, shares)
def test_a_larger_share_never_makes_an_input_wait_longer(arrivals, one, other):
    own = [work for work in arrivals if work.task == "a"]
    less, more = sorted((one, other))
    slow, fast = responses(serve(own, [quota(a=less)])), responses(serve(own, [quota(a=more)]))
    assert len(fast) >= len(slow)
    assert all(quick <= late + 1e-6 for quick, late in zip(fast, slow, strict=False))
