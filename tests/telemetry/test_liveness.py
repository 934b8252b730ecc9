"""What /metrics says about the operator while nothing on its loops answers."""

from __future__ import annotations

import threading

from prometheus_client import CollectorRegistry, generate_latest

from contextpolicy.app import probes
from contextpolicy.app.probes import Heartbeat
from contextpolicy.streams.loop import Loop, on_loop
from contextpolicy.telemetry.liveness import LoopDelays


class LoopThread:
    def __init__(self, loop):
        self._loop = loop

    def submit(self, beat):
        return on_loop(self._loop, beat)


def test_a_loop_that_hangs_is_seen_without_its_answer(monkeypatch):
    monkeypatch.setattr(probes, "PATIENCE", 0.01)
    loop, free, hangs = Loop(), threading.Event(), threading.Event()
    heartbeat, registry = Heartbeat(LoopThread(loop)), CollectorRegistry()
    registry.register(LoopDelays(lambda: {"the event loop": heartbeat.delay()}))

    def delay():
        return registry.get_sample_value("contextpolicy_loop_delay_seconds", {"loop": "the event loop"})

    def hang():
        hangs.set()
        free.wait(10)

    on_loop(loop, hang)
    assert hangs.wait(10)
    first = delay()
    assert delay() > first > 0
    free.set()
    on_loop(loop, lambda: None).result(10)
    assert delay() == 0
    loop.dispose()


def test_without_loops_no_delay_is_exported():
    registry = CollectorRegistry()
    registry.register(LoopDelays(dict))
    assert b"\ncontextpolicy_loop_delay_seconds{" not in generate_latest(registry)
