from __future__ import annotations

import signal
import threading

import pytest

from robotkit.termination import SIGNALS, stop_on_signals
from tests.waiting import PATIENCE


@pytest.fixture(autouse=True)
def _handlers():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    signal.set_wakeup_fd(-1)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_the_wait_whatever_the_main_thread_is_doing(number):
    then = threading.Event()
    stop = stop_on_signals(then.set)
    with stop._cond:  # type: ignore[attr-defined]  # not in the stubs; as where it begins to wait
        signal.raise_signal(number)
    assert stop.wait(PATIENCE)
    assert then.wait(PATIENCE)
