"""Which threads of kopf start again when namespaces come and go."""

from __future__ import annotations

from typing import ClassVar
from unittest.mock import Mock

import pytest

from contextpolicy.app import kopf_threads
from contextpolicy.app.kopf_threads import MOST, KopfThreads


class FakeThread:
    """Kopf for some namespaces; `all` are those that were started."""

    all: ClassVar[list[FakeThread]] = []

    def __init__(self, _operator, namespaces, _listener):
        self.namespaces, self.failed, self.stopped = frozenset(namespaces), False, False
        self.beats = []
        self.all.append(self)

    def begin_stop(self):
        self.stopping = True

    def stop(self):
        assert self.stopping
        self.stopped = True

    def submit(self, beat):
        self.beats.append(beat)


@pytest.fixture
def started(monkeypatch):
    monkeypatch.setattr(kopf_threads, "KopfThread", FakeThread)
    monkeypatch.setattr(FakeThread, "all", [])
    return FakeThread.all


@pytest.fixture
def kopf(started):  # noqa: ARG001 - what it starts
    return KopfThreads(Mock(), Mock())


def running(started):
    return [set(one.namespaces) for one in started if not one.stopped]


def test_a_namespace_that_comes_leaves_the_others_alone(kopf, started):
    kopf.serve(frozenset({"lab", "hall"}))
    kopf.serve(frozenset({"lab", "hall", "dock"}))
    assert running(started) == [{"lab", "hall"}, {"dock"}]
    assert not any(one.stopped for one in started)
    assert kopf.namespaces == {"lab", "hall", "dock"}


def test_a_namespace_that_goes_restarts_only_its_own_thread(kopf, started):
    kopf.serve(frozenset({"lab", "hall"}))
    kopf.serve(frozenset({"lab", "hall", "dock"}))
    kopf.serve(frozenset({"lab", "hall"}))
    assert running(started) == [{"lab", "hall"}]
    kopf.serve(frozenset({"hall"}))
    assert running(started) == [{"hall"}]
    kopf.serve(frozenset())
    assert running(started) == []


def test_the_number_of_threads_is_bounded(kopf, started):
    names = [f"robot-{number}" for number in range(2 * MOST + 1)]
    for count in range(1, len(names) + 1):
        kopf.serve(frozenset(names[:count]))
        assert set().union(*running(started)) == set(names[:count])
        assert len(running(started)) <= MOST
    assert len([one for one in started if one.stopped]) == 2 * MOST, "all start again twice, together"


def test_it_has_failed_if_one_thread_has(kopf, started):
    kopf.serve(frozenset({"lab"}))
    kopf.serve(frozenset({"lab", "hall"}))
    assert not kopf.failed
    started[0].failed = True
    assert kopf.failed


def test_it_beats_once_all_threads_have(kopf, started):
    beats = []
    kopf.submit(lambda: beats.append("at once"))
    kopf.serve(frozenset({"lab"}))
    kopf.serve(frozenset({"lab", "hall"}))
    kopf.submit(lambda: beats.append("late"))
    asked = [one for one in started if one.beats]
    assert (len(asked), beats) == (1, ["at once"])
    asked[0].beats.pop()()
    [other] = [one for one in started if one.beats]
    assert beats == ["at once"]
    other.beats.pop()()
    assert beats == ["at once", "late"]


def test_all_are_ended_at_once(kopf, started):
    kopf.serve(frozenset({"lab"}))
    kopf.serve(frozenset({"lab", "hall"}))
    kopf.stop()
    assert running(started) == []
