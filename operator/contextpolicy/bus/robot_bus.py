"""What an operator has of the robot's bus: the session, whether a router answers, and what the nodes' agents tell."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Protocol

from contextpolicy.bus.agent_watch import AgentWatch
from contextpolicy.bus.connection import Connection
from contextpolicy.bus.usage_watch import UsageWatch
from contextpolicy.streams.loop import on_loop

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import zenoh
    from reactivex.abc import SchedulerBase

    from contextpolicy.bus.usage_watch import Usage
    from contextpolicy.cluster.agent_reports import AgentReport, Stamp

log = logging.getLogger(__name__)


class BusListener(Protocol):
    """What hears of the bus; called on the loop."""

    def on_session(self) -> None:
        """There is a session."""

    def on_agents(self) -> None:
        """An agent's report has changed, or which containers it could not set."""

    def on_router(self) -> None:
        """The router came or went."""


class RobotBus:
    """Empty until it is opened. Everything but `open`, `stop` and `close` belongs to the loop's thread."""

    def __init__(self, loop: SchedulerBase) -> None:
        self.session: zenoh.Session | None = None
        self.connected = False
        """Whether a router answers."""
        self._loop = loop
        self._agents: AgentWatch | None = None
        self._usage: UsageWatch | None = None
        self._connection: Connection | None = None

    def open(
        self,
        session: zenoh.Session,
        listener: BusListener,
    ) -> None:
        """Take the session and follow the agents and the router; blocks up to a second for the agents' answers."""
        agents = AgentWatch(session, self._loop, lambda: on_loop(self._loop, listener.on_agents))
        on_loop(self._loop, lambda: self._begin(session, agents, listener))
        self._connection = Connection(
            session, lambda connected: on_loop(self._loop, lambda: self._link(listener, connected=connected))
        )

    def stop(self) -> None:
        """Follow nothing any more; what was heard already may still use the session, on the loop."""
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
        """Nobody makes plans for this policy any more: expect no more confirmations."""
        if self._agents is not None:
            self._agents.forget(policy)

    def _begin(self, session: zenoh.Session, agents: AgentWatch, listener: BusListener) -> None:
        self.session, self._agents, self._usage = session, agents, UsageWatch(session, self._loop)
        listener.on_session()

    def _link(self, listener: BusListener, *, connected: bool) -> None:
        if connected is not self.connected:
            self.connected = connected
            log.log(logging.INFO if connected else logging.WARNING, "the bus is %s", "there" if connected else "lost")
            listener.on_router()
