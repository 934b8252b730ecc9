"""Between Zenoh's threads and the loop: in order, bounded, one wake-up, and timestamps on the loop's clock."""

from __future__ import annotations

import itertools
import time
from collections import deque
from dataclasses import replace
from threading import Thread
from typing import Any

import pytest
from reactivex.scheduler import VirtualTimeScheduler
from reactivex.testing import TestScheduler

from contextpolicy.planning.inputs import Gone
from contextpolicy.policy.stream_spec import Encoding
from contextpolicy.streams.backlog import PER_STREAM, PLACE, TOTAL, Backlog
from contextpolicy.streams.decoding import Decoder
from contextpolicy.streams.subscription import BATCH, Waiting, _Inbox
from tests.streams.heard import IMU, MIC, Heard
from tests.waiting import PATIENCE


class Box:
    """An inbox, with a lane for each stream that something is put in for."""

    def __init__(self, scheduler: Any, heard: Any, backlog: Backlog[Waiting] | None = None) -> None:
        self._inbox = _Inbox(heard, scheduler, backlog or Backlog(PER_STREAM, TOTAL), heard)
        self._lanes: dict[str, Any] = {}
        self.close = self._inbox.close
        self.refuse = self._inbox.refuse

    def put(self, decoder: Decoder, payload: bytes) -> None:
        self._inbox.put(self.lane(decoder.stream.name), decoder, payload)

    def put_gone(self, stream: str) -> None:
        self._inbox.put_gone(self.lane(stream), stream)

    def lane(self, stream: str) -> Any:
        if stream not in self._lanes:
            self._lanes[stream] = self._inbox.lane(stream)
        return self._lanes[stream]


def an_inbox(scheduler, heard, backlog=None):
    return Box(scheduler, heard, backlog)


def test_overrun_drops_only_the_oldest_of_that_stream():
    scheduler, heard = TestScheduler(), Heard()
    inbox, imu, mic = an_inbox(scheduler, heard, Backlog(10 * (PLACE + 9), TOTAL)), Decoder(IMU), Decoder(MIC)
    inbox.put(mic, b'{"level": 1}')
    for n in range(24):
        inbox.put(imu, b'{"n": %2d}' % n)
    scheduler.advance_by(1)
    assert heard.values() == [{"n": n} for n in range(14, 24)]
    assert heard.values("mic") == [{"level": 1}]
    assert heard.drops == [("imu", "overrun")] * 14


def test_large_payloads_count_with_their_bytes():
    scheduler, heard = TestScheduler(), Heard()
    inbox, imu = an_inbox(scheduler, heard, Backlog(100_000, TOTAL)), Decoder(IMU)
    for n in range(24):
        inbox.put(imu, b'{"n": %d}' % n + b" " * 30_000)
    scheduler.advance_by(1)
    assert heard.values() == [{"n": n} for n in range(21, 24)]
    assert len(heard.drops) == 21


def test_a_sample_that_there_is_no_room_to_keep_is_dropped():
    scheduler, heard = TestScheduler(), Heard()
    inbox = an_inbox(scheduler, heard)
    inbox.put(Decoder(IMU), b"{}")
    scheduler.advance_by(1)
    heard.full = True
    inbox.put(Decoder(IMU), b"{}")
    scheduler.advance_by(1)
    assert (len(heard.inputs), heard.drops) == (1, [("imu", "memory")])


def test_oversized_samples_are_counted():
    scheduler, heard = TestScheduler(), Heard()
    inbox = an_inbox(scheduler, heard)
    inbox.refuse("imu")
    inbox.refuse("imu")
    scheduler.advance_by(1)
    assert heard.drops == [("imu", "oversized")] * 2


def test_a_closed_inbox_is_empty_and_delivers_nothing():
    scheduler, heard, backlog = TestScheduler(), Heard(), Backlog[Waiting](PER_STREAM, TOTAL)
    inbox = an_inbox(scheduler, heard, backlog)
    inbox.put(Decoder(IMU), b"{}")
    inbox.close()
    inbox.put(Decoder(IMU), b"{}")
    scheduler.advance_by(1)
    assert heard.inputs == []
    assert not inbox.lane("imu").waiting


def test_a_storm_does_not_starve_other_actions(monkeypatch):
    """Each handled sample is followed by a new one: timers and finished patches still run."""
    scheduler, heard = TestScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)
    others: list[str] = []
    put_again = heard.on_next

    def on_next(event):
        put_again(event)
        if not others:
            inbox.put(decoder, b"{}")

    monkeypatch.setattr(heard, "on_next", on_next)
    inbox.put(decoder, b"{}")
    scheduler.schedule(lambda *_: others.append("a patch"))
    scheduler.advance_by(1)
    assert others == ["a patch"]
    assert len(heard.inputs) == 2


def test_a_backlog_yields_to_other_actions_after_each_batch():
    scheduler, heard, turns = TestScheduler(), Heard(), []
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)
    for n in range(2 * BATCH + 1):
        inbox.put(decoder, b'{"n": %d}' % n)
    for _ in range(2):
        scheduler.schedule(lambda *_: turns.append(len(heard.inputs)))
    scheduler.advance_by(1)
    assert turns == [BATCH, BATCH]
    assert heard.values() == [{"n": n} for n in range(2 * BATCH + 1)]


def test_a_sample_that_comes_while_the_loop_falls_asleep_wakes_it_once(monkeypatch):
    scheduler, heard, decoder = TestScheduler(), Heard(), Decoder(IMU)

    class Late(deque[Any]):
        """Empty when it is looked at, and no more just after."""

        def __bool__(self):
            empty = len(self) == 0
            if empty and len(heard.inputs) < 3:
                inbox.put(decoder, b"{}")
            return not empty

    inbox = an_inbox(scheduler, heard)
    inbox.lane("imu").waiting = Late()

    drains: list[Any] = []
    run = scheduler.schedule

    def schedule(action, state=None):
        drains.append(action)
        return run(action, state)

    monkeypatch.setattr(scheduler, "schedule", schedule)
    inbox.put(decoder, b"{}")
    scheduler.advance_by(1)
    assert len(heard.inputs) == 3
    assert len(drains) == 3


@pytest.fixture
def stamped(monkeypatch):
    """What the planner gets of a timestamp of 17.0 where looks at the wall clock show these; the loop's stands at 0."""
    scheduler, heard = VirtualTimeScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(replace(IMU, timestamp="stamp"))

    def stamped(*readings):
        shown = itertools.cycle(readings)
        with monkeypatch.context() as patch:
            patch.setattr(time, "time", lambda: next(shown))
            inbox.put(decoder, b'{"stamp": 17.0}')
            scheduler.start()
        return heard.inputs[-1].timestamp

    return stamped


@pytest.mark.parametrize("set_to", [0.0, 1000.0])
def test_equal_timestamps_stay_equal(stamped, set_to):
    """They are judged by their order, and a simulation's clock may stand still."""
    first = stamped(set_to)
    assert {stamped(set_to + noise) for noise in (4e-6, -3e-6, 1e-3, -1e-3)} == {first}


def test_a_wall_clock_that_is_set_shifts_timestamps(stamped):
    assert [stamped(wall) for wall in (0.0, 60.0, 60.0, 0.0)] == [17.0, -43.0, -43.0, 17.0]


def test_an_interruption_between_clock_reads_shifts_no_timestamp(stamped):
    assert [stamped(0.1, 0.0), stamped(0.0)] == [17.0, 17.0]


def test_a_batch_keeps_the_order_across_streams_and_ends(monkeypatch):
    clock = iter(range(100))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)))
    scheduler, heard = TestScheduler(), Heard()
    inbox, imu, mic = an_inbox(scheduler, heard), Decoder(IMU), Decoder(MIC)
    inbox.put(mic, b'{"level": 1}')
    inbox.put(imu, b'{"n": 1}')
    inbox.put_gone("mic")
    inbox.put(imu, b'{"n": 2}')
    inbox.put(mic, b'{"level": 2}')
    scheduler.advance_by(1)
    reported = [event if isinstance(event, Gone) else (event.stream, event.arrived) for event in heard.inputs]
    assert reported == [("mic", 0.0), ("imu", 1.0), Gone("mic"), ("imu", 2.0), ("mic", 3.0)]


def test_the_loop_is_woken_once_for_all_that_wait():
    scheduler, heard = TestScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)
    for _ in range(50):
        inbox.put(decoder, b"{}")
    assert len(scheduler._queue) == 1
    scheduler.advance_by(1)
    assert len(heard.inputs) == 50
    inbox.put(decoder, b"{}")
    assert len(scheduler._queue) == 1


def test_a_reader_that_fails_does_not_end_the_stream(monkeypatch):
    scheduler, heard = TestScheduler(), Heard()
    inbox, decoder = an_inbox(scheduler, heard), Decoder(IMU)
    take = heard.on_next

    def fail_once(_):
        monkeypatch.setattr(heard, "on_next", take)
        raise RuntimeError("by accident")

    monkeypatch.setattr(heard, "on_next", fail_once)
    inbox.put(decoder, b'{"n": 1}')
    inbox.put(decoder, b'{"n": 2}')
    with pytest.raises(RuntimeError):
        scheduler.advance_by(1)
    scheduler.stop()
    scheduler.advance_by(1)
    assert heard.values() == [{"n": 2}]


def test_many_threads_may_put_at_once(loop):
    heard = Heard()
    inbox = an_inbox(loop, heard)
    decoders = [Decoder(replace(IMU, name=f"imu{n}", encoding=Encoding.JSON)) for n in range(8)]

    def put_all(decoder):
        for n in range(500):
            inbox.put(decoder, b'{"n": %d}' % n)

    threads = [Thread(target=put_all, args=(decoder,)) for decoder in decoders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    heard.wait_for(lambda h: len(h.inputs) == 4000)
    for n in range(8):
        assert heard.values(f"imu{n}") == [{"n": n} for n in range(500)]


@pytest.mark.parametrize("closed", ["before", "after"])
@pytest.mark.parametrize("lost", ["oversized", "overrun"])
def test_a_closed_inbox_reports_nothing_though_a_drain_was_queued(closed, lost):
    """Its policy is gone, and reporting the loss would create the policy's metrics again."""
    scheduler, heard = TestScheduler(), Heard()
    inbox = an_inbox(scheduler, heard, Backlog(PLACE + 2, TOTAL))
    inbox.put(Decoder(IMU), b"{}")
    if closed == "before":
        inbox.close()
    for _ in range(2):
        if lost == "oversized":
            inbox.refuse("imu")
        else:
            inbox.put(Decoder(IMU), b"{}")
    if closed == "after":
        inbox.close()
    scheduler.advance_by(1)
    assert heard.drops == []


def test_an_inbox_that_its_listener_closes_no_longer_reports(monkeypatch):
    scheduler, heard = TestScheduler(), Heard()
    inbox = an_inbox(scheduler, heard)
    on_drop = heard.on_drop

    def end(stream, reason):
        on_drop(stream, reason)
        inbox.close()

    monkeypatch.setattr(heard, "on_drop", end)
    inbox.lane("imu")
    for _ in range(3):
        inbox.refuse("imu")
    scheduler.advance_by(1)
    assert heard.drops == [("imu", "oversized")]
