"""Agents' confirmations on their way to the loop: the newest of each node and policy, however fast they come."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Protocol

from contextpolicy.bus.decision_bus import node_of
from contextpolicy.cluster.agent_reports import MOST_BYTES, read_confirmation

if TYPE_CHECKING:
    from collections.abc import Collection

    import zenoh
    from reactivex.abc import SchedulerBase

    from contextpolicy.cluster.agent_reports import Confirmation


MOST_WAITING = 256
"""Confirmations that wait, unless they are about a policy whose plans are published: one may come sooner than that is
noted."""


class ConfirmationListener(Protocol):
    """Receives confirmations; called on the loop's thread."""

    def on_confirmed(self, node: str, said: Confirmation) -> None:
        """The node's agent has carried out a plan, and none after it."""


class Confirmations:
    """Those from `nodes`, above all about `policies`: anyone with an agent's certificate may name others."""

    def __init__(
        self,
        scheduler: SchedulerBase,
        listener: ConfirmationListener,
        nodes: Collection[str],
        policies: Collection[str],
    ) -> None:
        self._scheduler, self._listener = scheduler, listener
        self._nodes, self._policies = nodes, policies
        self._waiting: dict[tuple[str, str], Confirmation] = {}
        self._lock = Lock()

    def on_sample(self, sample: zenoh.Sample) -> None:
        """One arrives; called on a Zenoh thread, which must not block."""
        node = node_of(str(sample.key_expr))
        if node not in self._nodes or len(sample.payload) > MOST_BYTES:
            return
        said = read_confirmation(sample.payload.to_bytes())
        if said is not None:
            self._put(node, said)

    def _put(self, node: str, said: Confirmation) -> None:
        place = node, said.policy
        with self._lock:
            asleep, waiting = not self._waiting, self._waiting.get(place)
            room = waiting is not None or said.policy in self._policies or len(self._waiting) < MOST_WAITING
            if room and (waiting is None or waiting.stamp <= said.stamp):
                self._waiting[place] = said
        if asleep:
            self._scheduler.schedule(self._drain)

    def _drain(self, *_: object) -> None:
        with self._lock:
            heard, self._waiting = self._waiting, {}
        for (node, _policy), said in heard.items():
            self._listener.on_confirmed(node, said)
