"""Tasks stay on the processors that are theirs."""

from __future__ import annotations

import os
import subprocess
import threading

import pytest

from timelines.demo.deploy import DeployError
from timelines.experiments import thief
from timelines.experiments.confine import check, confine, first, keep_off, punctual


class Container:
    """A cgroup with these processes."""

    def __init__(self, *processes):
        self._processes = list(processes)

    def processes(self):
        return self._processes


@pytest.fixture
def task():
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


def test_a_task_runs_on_its_processors_and_its_neighbours_where_they_did(task):
    before, gone = os.sched_getaffinity(0), 2**22 - 1
    containers = {"slam": Container(task.pid, gone), "router": Container(os.getpid())}
    confine(containers, ["slam", "signs"], first(1))
    assert os.sched_getaffinity(task.pid) == first(1)
    assert os.sched_getaffinity(0) == before
    check(containers, ["slam"], first(1))


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is nowhere else")
def test_one_that_got_more_is_found(task):
    containers = {"slam": Container(task.pid)}
    with pytest.raises(DeployError, match="may run on processors other than"):
        check(containers, ["slam"], first(1))


def test_a_task_whose_container_was_started_again_is_found():
    with pytest.raises(DeployError, match="container of slam has ended"):
        check({"slam": Container()}, ["slam"], first(1))


def test_so_is_one_of_the_control_whose_cpu_would_count_as_negative(task):
    containers = {"slam": Container(task.pid), "operator": Container()}
    confine(containers, ["slam"], first(1))
    with pytest.raises(DeployError, match="container of operator has ended"):
        check(containers, ["slam"], first(1))


def test_what_plays_and_records_stays_away_from_the_tasks_where_there_is_room():
    allowed, tasks, other = os.sched_getaffinity(0), first(1), threading.Event()
    beside = threading.Thread(target=other.wait)
    beside.start()
    try:
        with keep_off(tasks):
            rest = allowed - tasks or allowed
            assert os.sched_getaffinity(0) == os.sched_getaffinity(beside.native_id or 0) == rest
        with keep_off(allowed):  # none is left
            assert os.sched_getaffinity(0) == allowed
        assert os.sched_getaffinity(beside.native_id or 0) == allowed
    finally:
        other.set()
        beside.join()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs permission to use realtime priorities")
def test_what_plays_runs_before_the_tasks_and_after_what_slows_the_processors():
    before, end = os.sched_getscheduler(0), threading.Event()
    there, later = threading.Thread(target=end.wait), threading.Thread(target=end.wait)
    there.start()
    try:
        with punctual():
            later.start()
            for thread in (0, there.native_id or 0, later.native_id or 0):
                assert os.sched_getscheduler(thread) == os.SCHED_FIFO
                assert 0 < os.sched_getparam(thread).sched_priority < thief.PRIORITY
        assert {os.sched_getscheduler(one) for one in (0, there.native_id or 0, later.native_id or 0)} == {before}
    finally:
        end.set()
        there.join()
        later.join()
