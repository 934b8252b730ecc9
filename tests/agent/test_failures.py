"""Which containers a failed write concerns."""

from __future__ import annotations

from pathlib import Path

from contextpolicy.agent.failures import attempt, by_container
from contextpolicy.errors import ActuationError

BUSY = ActuationError("Busy", "", retriable=True)
A, B, C = Path("/pod1/a"), Path("/pod1/b"), Path("/pod10/c")
CONTAINERS = {A: "a", B: "b", C: "c"}


def test_a_failure_concerns_every_container_below():
    assert by_container({Path("/pod1"): BUSY}, CONTAINERS) == {"a": "Busy", "b": "Busy"}
    assert by_container({A: BUSY, Path("/pod2/x"): BUSY}, CONTAINERS) == {"a": "Busy"}
    assert by_container({}, CONTAINERS) == {}


def test_failed_action_fails_its_dependents():
    def fail():
        raise BUSY

    assert attempt(fail, A, B) == {A: BUSY, B: BUSY}
    assert attempt(list, A, B) == {}
