"""The time at each hop of the path from a sample to the cgroup, noted around functions of the running code."""

from __future__ import annotations

import importlib
import time
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    Notes = list[tuple[str, int]]
    """Each hop with its Unix time in nanoseconds."""


@dataclass(frozen=True)
class Hop:
    """A moment on the path: when a function begins, or (`end`) returns. `what` ends there."""

    what: str
    function: str
    end: bool = False


OPERATOR = (
    Hop("sensor, router, operator's callback", "contextpolicy.streams.subscription:_Inbox.put"),
    Hop("to the operator's loop", "contextpolicy.streams.subscription:_Inbox._drain"),
    Hop("decode, decide", "contextpolicy.policies.policy_runner:PolicyRunner.instruct_agents"),
    Hop("what precedes the message", "contextpolicy.policies.plan_publisher:PlanPublisher._publish"),
    Hop("make the message", "contextpolicy.bus.decision_bus:Bus.publish"),
    Hop("encode", "contextpolicy.bus.signatures:Signer.sign"),
    Hop("sign", "contextpolicy.bus.signatures:Signer.sign", end=True),
)
AGENT = (
    Hop("operator, router, agent's callback", "contextpolicy.agent.bus_link:AgentBus._take"),
    Hop("verify", "contextpolicy.agent.bus_link:AgentBus._put"),
    Hop("to the agent's loop", "contextpolicy.agent.agent:Agent.hear"),
    Hop("read, admit", "contextpolicy.agent.agent:Agent._obey"),
    Hop("find cgroups, settle", "contextpolicy.agent.limits:Limits.apply"),
    Hop("read limits, record", "contextpolicy.agent.control_files:ControlFile.write"),
    Hop("write", "contextpolicy.agent.control_files:ControlFile.write", end=True),
)
LAST = AGENT[-1].what
"""Of this hop the last note counts, of all others the first."""


class Stamps:
    """Notes what passes through the hops of one process."""

    def __init__(self, hops: Iterable[Hop]) -> None:
        self._notes: Notes = []
        for hop in hops:
            owner, name = found(hop.function)
            setattr(owner, name, self._noting(getattr(owner, name), hop))

    def take(self) -> Notes:
        """What was noted since this was last called."""
        notes, self._notes = self._notes, []
        return notes

    def _noting(self, function: Callable[..., Any], hop: Hop) -> Callable[..., Any]:
        @wraps(function)
        def noted(*arguments: Any, **options: Any) -> Any:
            if not hop.end:
                self._notes.append((hop.what, time.time_ns()))
                return function(*arguments, **options)
            result = function(*arguments, **options)
            self._notes.append((hop.what, time.time_ns()))
            return result

        return noted


def found(function: str) -> tuple[Any, str]:
    """The class of a function, and its name there; AttributeError when the code has no such function any more."""
    module, _, path = function.partition(":")
    owner, _, name = path.rpartition(".")
    return getattr(importlib.import_module(module), owner), name


def legs(notes: Notes, began: int) -> dict[str, float] | None:
    """Milliseconds of each hop after the one before it, in order; None when one is missing."""
    at, reported = began, {}
    for hop in (*OPERATOR, *AGENT):
        moments = [moment for what, moment in notes if what == hop.what and moment >= began]
        if not moments:
            return None
        reached = max(moments) if hop.what == LAST else min(moments)
        reported[hop.what], at = (reached - at) / 1e6, reached
    return reported
