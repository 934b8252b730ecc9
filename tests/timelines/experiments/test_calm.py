"""A run begins when the machine is quiet, or not at all."""

from __future__ import annotations

import pytest

from timelines.demo.deploy import DeployError
from timelines.experiments.calm import LOOK, wait_until_calm


def machine(*parts):
    """A machine with two processors, busy to these parts in one look after the other, the last one forever."""
    looks: list[float] = []
    state = {"busy": 0.0}

    def sleep(seconds):
        state["busy"] += 2 * parts[min(len(looks), len(parts) - 1)] * seconds
        looks.append(seconds)

    return looks, lambda: state["busy"], sleep


def test_it_waits_while_something_else_runs():
    looks, busy, sleep = machine(0.9, 0.5, 0.1)
    assert wait_until_calm(busy, sleep, 2) == pytest.approx(0.1)
    assert len(looks) == 3


def test_on_a_machine_that_is_never_quiet_nothing_is_measured():
    looks, busy, sleep = machine(0.7)
    with pytest.raises(DeployError, match="70% busy after 180 s"):
        wait_until_calm(busy, sleep, 2)
    assert len(looks) == 180 / LOOK
