"""The end of what a task reports."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from robotkit import reporter as reporter_module
from robotkit.cgroup import Usage
from robotkit.profile import Profile
from robotkit.quality import Quality
from robotkit.reporter import Reporter
from tests.modules.robotkit.bus import client, router
from tests.modules.robotkit.world import ECHO
from tests.waiting import PATIENCE

NOTHING = SimpleNamespace(dropped={}, shared={}, unfinished=())


def test_the_message_of_the_moment_is_sent_before_the_session_may_be_closed(monkeypatch):
    monkeypatch.setattr(reporter_module, "EVERY_S", 0.01)
    monkeypatch.setattr(reporter_module, "LAST_S", PATIENCE)
    making, made = threading.Event(), threading.Event()

    def cpu():
        if threading.current_thread().name == "health":
            making.set()
            made.wait(PATIENCE)
        return 0

    with router() as address, client(address) as session, ThreadPoolExecutor(1) as pool:
        reporter = Reporter(session, "echo", Profile(ECHO), NOTHING, Quality(None), Usage(cpu, throttling=lambda: None))
        assert making.wait(PATIENCE)
        closing = pool.submit(reporter.close)
        with pytest.raises(TimeoutError):
            closing.result(0.2)
        made.set()
        closing.result(PATIENCE)
    assert not any(thread.name == "health" for thread in threading.enumerate())
