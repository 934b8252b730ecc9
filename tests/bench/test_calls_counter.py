from __future__ import annotations

import json
import sys
import threading

import pytest
from reactivex.scheduler import ImmediateScheduler

from contextpolicy.policy.quantities import format_cpu
from contextpolicy.streams.loop import on_loop
from tests.bench.calls_counter import Call, CallCounter, own, shown, until_quiet


@pytest.fixture
def counter():
    former = sys.getprofile(), threading.getprofile()
    yield CallCounter()
    sys.setprofile(former[0])
    threading.setprofile(former[1])


def test_only_calls_between_start_and_stop_count(counter):
    format_cpu(300)
    counter.start()
    format_cpu(300)
    before = counter.so_far()
    calls = counter.stop()
    format_cpu(300)
    assert before == len(calls) == 1
    assert [shown(call.file) for call in calls] == ["contextpolicy/policy/quantities.py"]


def test_library_calls_count_for_their_caller(counter):
    counter.start()
    json.dumps({}, indent=1)
    on_loop(ImmediateScheduler(), lambda: json.dumps({}, indent=1))
    calls = counter.stop()
    files = {shown(call.file) for call in calls}
    assert files >= {"contextpolicy/streams/loop.py", "concurrent/futures/_base.py"}
    assert not [file for file in files if "json" in file]
    assert len(own(calls)) < len(calls)


def test_threads_that_begin_later_count_too(counter):
    counter.start()
    thread = threading.Thread(target=format_cpu, args=(300,))
    thread.start()
    thread.join()
    assert [shown(call.file) for call in own(counter.stop())] == ["contextpolicy/policy/quantities.py"]


@pytest.mark.parametrize(
    ("moments", "after", "quiet"),
    [
        ([], 0, 0),
        ([1.0, 1.01, 1.02], 1, 3),
        ([1.0, 1.01, 1.2, 1.21], 1, 2),
        ([1.0, 1.2, 1.21, 1.4], 2, 3),
    ],
    ids=["nothing happens", "it ends busy", "a pause", "a pause before it counts"],
)
def test_until_quiet(moments, after, quiet):
    assert until_quiet([Call(at, "") for at in moments], after) == quiet
