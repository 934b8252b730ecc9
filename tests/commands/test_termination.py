from __future__ import annotations

import signal

import pytest

from contextpolicy.commands.termination import SIGNALS, stop_on_signals
from tests.waiting import PATIENCE


@pytest.fixture(autouse=True)
def _handlers():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_signal_does_not_deadlock_while_the_wait_lock_is_held(number):
    stop = stop_on_signals()
    with stop._cond:  # type: ignore[attr-defined]  # not in the stubs; as where it begins to wait
        signal.raise_signal(number)
    assert stop.wait(PATIENCE)
