"""A router that hangs is noticed, and one that is only slow is left alone."""

from __future__ import annotations

from threading import Event
from typing import Any

import pytest
import zenoh

from contextpolicy.bus import router_watch
from contextpolicy.bus.router_watch import MOST_MISSED, RouterWatch
from tests.waiting import PATIENCE, until


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(router_watch, "EVERY", 0.01)


class Router:
    """Stands for a session; `hangs` keeps whoever declares anything waiting."""

    def __init__(self):
        self.free, self.closed = Event(), False
        self.free.set()
        self.declared = self.undeclared = self.hung = 0

    def declare_keyexpr(self, key):
        if self.closed:
            raise zenoh.ZError("session closed")
        assert self.free.wait(PATIENCE)
        self.declared += 1
        return key

    def undeclare(self, _):
        self.undeclared += 1

    def on_hang(self):
        self.hung += 1


def watching(router: Any) -> RouterWatch:
    return RouterWatch(router, router)


def test_a_router_that_declares_is_left_alone_and_keeps_no_declaration():
    router = Router()
    with watching(router):
        until(lambda: router.declared > 3 * MOST_MISSED)
    until(lambda: router.undeclared == router.declared)
    assert router.hung == 0


def test_a_router_that_hangs_is_reported_once():
    router = Router()
    with watching(router):
        until(lambda: router.declared)
        router.free.clear()
        until(lambda: router.hung)
        router.free.set()
    assert router.hung == 1


def test_the_watch_of_a_closed_router_ends():
    router = Router()
    watch = watching(router)
    with watch:
        until(lambda: router.declared)
        router.closed = True
        until(watch._stop.is_set)
    assert router.hung == 0
