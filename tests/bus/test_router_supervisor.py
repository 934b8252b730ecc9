"""The router is started again when it is killed; with real processes that do nothing."""

from __future__ import annotations

import os
import sys
import threading

import pytest

from contextpolicy.bus.router_supervisor import IN_VAIN, RouterSupervisor
from tests.waiting import PATIENCE

KILLED = "os.kill(os.getpid(), signal.SIGKILL)"
CRASHED = "os.kill(os.getpid(), signal.SIGSEGV)"
ENDED = "os._exit(0)"


class Lives:
    """A supervisor of routers whose ends are given, and whether they routed before."""

    def __init__(self, *lives):
        self._lives = list(lives)
        self._routed = False
        self.started: list[int] = []
        self.supervisor = RouterSupervisor(self._start, lambda: self._routed)

    def _start(self, restarts):
        deed, self._routed = self._lives.pop(0)
        self.started.append(restarts)
        return os.posix_spawn(sys.executable, [sys.executable, "-S", "-c", f"import os, signal; {deed}"], os.environ)


@pytest.mark.parametrize("death", [KILLED, CRASHED])
def test_killed_router_is_restarted_with_its_restart_count(death):
    lives = Lives(*[(death, True)] * 20, (ENDED, True))
    assert lives.supervisor.run() == 0
    assert lives.started == list(range(21))


@pytest.mark.parametrize("code", [0, 2])
def test_router_that_exits_is_not_restarted(code):
    lives = Lives((f"os._exit({code})", True))
    assert lives.supervisor.run() == code
    assert lives.started == [0]


def test_supervisor_gives_up_after_repeated_failed_starts():
    lives = Lives(*[(KILLED, False)] * IN_VAIN)
    assert lives.supervisor.run() == 1
    assert len(lives.started) == IN_VAIN


def test_successful_run_resets_the_failure_count():
    vain = [(KILLED, False)] * (IN_VAIN - 1)
    lives = Lives(*vain, (KILLED, True), *vain, (ENDED, False))
    assert lives.supervisor.run() == 0


def test_stopping_ends_the_router():
    started = threading.Event()

    def start(_):
        router = os.posix_spawn(sys.executable, [sys.executable, "-c", "import time; time.sleep(600)"], os.environ)
        started.set()
        return router

    def stop():
        if started.wait(PATIENCE):
            supervisor.stop()

    supervisor = RouterSupervisor(start, lambda: True)
    threading.Thread(target=stop).start()
    assert supervisor.run() == 0


def test_no_router_is_started_after_stop():
    lives = Lives()
    lives.supervisor.stop()
    assert lives.supervisor.run() == 0
