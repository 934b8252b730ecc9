"""The scheduling policy of threads, with a process table in place of the kernel's."""

from __future__ import annotations

import os

import pytest

from contextpolicy.agent.threads import THREAD_FILES, make_ordinary, make_realtime
from contextpolicy.errors import ActuationError


class Processes:
    """Threads and their policies; a `birth` happens while they are being listed."""

    def __init__(self, group, version):
        self.policies, self.births, self._file = {}, [], group / THREAD_FILES[version]

    def start(self, thread, policy=os.SCHED_OTHER):
        self.policies[thread] = policy
        self._file.write_text("".join(f"{one}\n" for one in self.policies))

    def getscheduler(self, thread):
        if thread not in self.policies:
            raise ProcessLookupError
        return self.policies[thread]

    def setscheduler(self, thread, policy, parameters):
        assert (parameters.sched_priority > 0) == (policy != os.SCHED_OTHER)
        parent, self.policies[thread] = self.policies[thread], policy
        if self.births:
            self.start(self.births.pop(), parent)


@pytest.fixture(params=[1, 2])
def version(request):
    return request.param


@pytest.fixture
def processes(tmp_path, version, monkeypatch):
    made = Processes(tmp_path, version)
    monkeypatch.setattr(os, "sched_getscheduler", made.getscheduler)
    monkeypatch.setattr(os, "sched_setscheduler", made.setscheduler)
    return made


def test_all_threads_enter_and_leave_realtime(tmp_path, version, processes):
    for thread in (11, 12, 13):
        processes.start(thread)
    make_realtime(tmp_path, version, 10)
    assert set(processes.policies.values()) == {os.SCHED_RR}
    make_ordinary(tmp_path, version)
    assert set(processes.policies.values()) == {os.SCHED_OTHER}


def test_threads_created_during_the_switch_are_included(tmp_path, version, processes):
    processes.start(11)
    processes.births = [22, 21, 20]
    make_realtime(tmp_path, version, 10)
    assert processes.policies == dict.fromkeys((11, 20, 21, 22), os.SCHED_RR)


def test_thread_that_ends_during_the_switch_is_skipped(tmp_path, version, processes):
    processes.start(11)
    processes.start(12)
    del processes.policies[11]
    make_realtime(tmp_path, version, 10)
    assert processes.policies == {12: os.SCHED_RR}


def test_a_task_that_chose_realtime_itself_keeps_its_choice(tmp_path, version, processes):
    processes.start(11, os.SCHED_FIFO)
    make_realtime(tmp_path, version, 10)
    assert processes.policies == {11: os.SCHED_FIFO}


def test_threads_can_use_fifo(tmp_path, version, processes):
    processes.start(11)
    make_realtime(tmp_path, version, 10, os.SCHED_FIFO)
    assert processes.policies == {11: os.SCHED_FIFO}


def test_processes_of_another_namespace_cannot_be_scheduled(tmp_path, version, processes):
    processes.start(0)
    with pytest.raises(ActuationError, match="hostPID") as caught:
        make_realtime(tmp_path, version, 10)
    assert caught.value.reason == "NoHostPids"


def test_a_missing_capability_is_reported(tmp_path, version, processes, monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    processes.start(11)
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with pytest.raises(ActuationError) as caught:
        make_realtime(tmp_path, version, 10)
    assert caught.value.reason == "Forbidden"


def test_a_group_that_ended_is_gone(tmp_path, version):
    with pytest.raises(ActuationError) as caught:
        make_ordinary(tmp_path / "no", version)
    assert caught.value.reason == "Gone"
