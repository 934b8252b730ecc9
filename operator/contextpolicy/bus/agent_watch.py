"""Which nodes have an agent, and what each of them can do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy.bus.decision_bus import agent_key
from contextpolicy.cluster.agent_reports import AgentReport, read_report

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import DisposableBase, SchedulerBase

PATIENCE = 1.0
"""Seconds in which the agents that live already must be known: a plan made without them would move them to and fro."""
RETURN = 10.0
"""Seconds that an agent may be gone, as for an upgrade, before its node counts as without. To fall back and return at
once would be a quick revert of every limit, which kubelets get wrong (kubernetes#125205)."""


class AgentWatch:
    """Follows the agents' liveliness tokens; `on_change` is called on the loop's thread."""

    def __init__(self, session: zenoh.Session, scheduler: SchedulerBase, on_change: Callable[[], object]) -> None:
        """Waits for the agents' first answers: never call it on the loop's thread."""
        self._session, self._scheduler, self._on_change = session, scheduler, on_change
        self.reports = dict(self._ask())
        self._missed: dict[str, DisposableBase] = {}
        self._subscriber: Any = session.liveliness().declare_subscriber(agent_key("*"), self._on_token, history=True)

    def close(self) -> None:
        """Stop following; what was heard already may still use the session, on the loop."""
        self._subscriber.undeclare()

    def _ask(self) -> list[tuple[str, AgentReport]]:
        replies = self._session.get(agent_key("*"), timeout=PATIENCE)
        return [(_node(reply.ok.key_expr), read_report(reply.ok.payload.to_bytes())) for reply in replies if reply.ok]

    def _on_token(self, token: zenoh.Sample) -> None:
        """Zenoh's callbacks must not call Zenoh."""
        node, lives = _node(token.key_expr), token.kind == zenoh.SampleKind.PUT
        self._later(lambda: self._inquire(node) if lives else self._miss(node))

    def _miss(self, node: str) -> None:
        self._missed[node] = self._scheduler.schedule_relative(RETURN, lambda *_: self._set(node, None))

    def _inquire(self, node: str) -> None:
        if node in self._missed:
            self._missed.pop(node).dispose()
        self._session.get(agent_key(node), lambda reply: self._on_reply(node, reply), timeout=PATIENCE)

    def _on_reply(self, node: str, reply: zenoh.Reply) -> None:
        report = read_report(reply.ok.payload.to_bytes() if reply.ok else b"")
        self._later(lambda: self._set(node, report))

    def _set(self, node: str, report: AgentReport | None) -> None:
        before = dict(self.reports)
        if report is None:
            self.reports.pop(node, None)
        else:
            self.reports[node] = report
        if self.reports != before:
            self._on_change()

    def _later(self, action: Callable[[], None]) -> None:
        self._scheduler.schedule(lambda *_: action())


def _node(key: zenoh.KeyExpr) -> str:
    return str(key).rpartition("/")[2]
