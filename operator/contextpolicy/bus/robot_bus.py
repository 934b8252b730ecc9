"""The operator's side of the robot's bus: the session, whether a router answers, and the node agents' reports."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Protocol

from contextpolicy.bus.agent_watch import AgentListener, AgentWatch
from contextpolicy.bus.connection import Connection
from contextpolicy.bus.usage_watch import UsageWatch
from contextpolicy.streams.loop import on_loop

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    import zenoh
    from reactivex.abc import SchedulerBase

    from contextpolicy.bus.usage_watch import Usage
    from contextpolicy.cluster.agent_reports import AgentReport, Stamp

log = logging.getLogger(__name__)


class BusListener(AgentListener, Protocol):
    """Receives news of the bus; called on the loop."""

    def on_session(self) -> None:
        """The session is open."""

    def on_router(self) -> None:
        """The router connected or disconnected."""


class RobotBus:
    """Empty until it is opened. Everything but `open`, `stop` and `close` belongs to the loop's thread."""

    def __init__(self, loop: SchedulerBase, listener: BusListener) -> None:
        self.session: zenoh.Session | None = None
        self.connected = False
        """Whether a router answers."""
        self._loop, self._listener = loop, listener
        self._nodes: set[str] = set()
        """The cluster's nodes: reports of others are ignored."""
        self._agents: AgentWatch | None = None
        self._usage: UsageWatch | None = None
        self._connection: Connection | None = None

    def open(self, session: zenoh.Session) -> None:
        """Take the session and follow the agents and the router; blocks up to a second for the agents' answers."""
        agents = AgentWatch(session, self._loop, self._listener, self._nodes)
        on_loop(self._loop, lambda: self._begin(session, agents))
        self._connection = Connection(session, self)

    def stop(self) -> None:
        """Stop following; messages already received may still use the session, on the loop."""
        if self._connection is not None:
            self._connection.close()
        if self._agents is not None:
            self._agents.close()

    def close(self) -> None:
        """Close the session."""
        if self.session is not None:
            self.session.close()

    @property
    def reports(self) -> Mapping[str, AgentReport]:
        """What each node's agent can do."""
        return self._agents.reports if self._agents else {}

    @property
    def gone(self) -> Collection[str]:
        """The nodes whose agent was there and is gone (see `AgentWatch.gone`)."""
        return self._agents.gone if self._agents else ()

    def take_node(self, node: str) -> None:
        """The cluster has gained this node."""
        if node not in self._nodes:
            self._nodes.add(node)
            if self._agents is not None:
                self._agents.look(node)

    def lose_node(self, node: str) -> None:
        """The cluster has lost this node."""
        self._nodes.discard(node)

    def usage(self) -> Mapping[str, Usage]:
        """The latest usage by container ID (see `UsageWatch.now`)."""
        return self._usage.now() if self._usage else {}

    def expect(self, policy: str, stamp: Stamp, nodes: Iterable[str], standstill: float) -> None:
        """A plan was published: the agents on `nodes` must confirm it (see `AgentWatch.expect`)."""
        if self._agents is not None:
            self._agents.expect(policy, stamp, nodes, standstill)

    def failures(self, policy: str) -> Mapping[str, Mapping[str, str]]:
        """The containers that agents could not set (see `AgentWatch.failures`)."""
        return self._agents.failures(policy) if self._agents is not None else {}

    def forget(self, policy: str) -> None:
        """The policy's source of plans is gone: expect no more confirmations."""
        if self._agents is not None:
            self._agents.forget(policy)

    def on_connection(self, *, connected: bool) -> None:
        """Pass it on to the loop."""
        on_loop(self._loop, lambda: self._link(connected=connected))

    def _begin(self, session: zenoh.Session, agents: AgentWatch) -> None:
        self.session, self._agents, self._usage = session, agents, UsageWatch(session, self._loop, self._nodes)
        self._listener.on_session()

    def _link(self, *, connected: bool) -> None:
        if connected is not self.connected:
            self.connected = connected
            level, state = (logging.INFO, "connected") if connected else (logging.WARNING, "disconnected")
            log.log(level, "router %s", state)
            self._listener.on_router()
