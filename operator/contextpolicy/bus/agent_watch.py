"""Which nodes have an agent, and the capabilities of each."""

from __future__ import annotations

import logging
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol

import zenoh

from contextpolicy.bus.agent_failures import AgentFailures
from contextpolicy.bus.confirmations import Confirmations
from contextpolicy.bus.decision_bus import agent_key, confirmed_key, node_of
from contextpolicy.bus.doubts import Doubts
from contextpolicy.bus.unconfirmed import Unconfirmed
from contextpolicy.cluster.agent_reports import LATE, NO_ANSWER, NOT_CONFIRMING, AgentReport, read_report
from contextpolicy.streams.direct import directly

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

    from reactivex.abc import DisposableBase, SchedulerBase

    from contextpolicy.cluster.agent_reports import Confirmation, Stamp

log = logging.getLogger(__name__)

PATIENCE = 1.0
"""Seconds to wait at start for the running agents: a plan made without them would be reversed once they are known."""
LONG_PATIENCE = 10.0
"""Seconds allowed for each later answer: the agent's node may be busy or still booting."""
PAUSE = 1.0
"""Seconds before asking an agent again that did not answer."""
RETURN = 10.0
"""Seconds an agent may be gone, for an upgrade say, before its node counts as having none (see `doubts.FIRST`)."""

MOST_NODES = 5000
"""Nodes that a cluster has at most (kubernetes.io, "Considerations for large clusters")."""
BOUND = 0.5
"""Seconds an agent has to confirm a plan. It needs milliseconds, but a busy node may keep it waiting."""
STANDSTILLS = 3
"""How often realtime tasks may keep a plan waiting for a period's end: at operator, router and agent."""


class AgentListener(Protocol):
    """Receives news of agents; called on the loop's thread."""

    def on_agents(self) -> None:
        """An agent's report has changed, or which containers it could not set."""

    def on_confirmation(self, node: str, said: Confirmation) -> None:
        """A node's agent has carried out a plan, but for the containers that it names."""

    def on_trial(self, node: str) -> None:
        """A node's agent answers, but has not confirmed a plan: publish those again that it has to carry out."""


class AgentWatch:
    """Follows the agents' liveliness tokens.

    The token says that an agent is alive, its answer what it can do. An agent is asked until it answers, and the plans
    in force are then published to it; plans can't count on it until it has confirmed these, if there are any. The same
    holds for an agent that does not confirm a plan in time: a frozen process keeps its token, and one that refuses
    plans answers whatever it is asked. It is left alone for a while, longer each time (`doubts`), and then asked again.
    A confirmation names the containers that the agent could not set: plans can't count on it for these.

    A certificate of the role agent does not say of which node: anyone who has one may speak for any. So only `nodes`
    that the cluster has are asked and believed, which bounds what thousands of invented ones could take.
    """

    def __init__(
        self, session: zenoh.Session, scheduler: SchedulerBase, listener: AgentListener, nodes: Collection[str]
    ) -> None:
        """Blocks up to PATIENCE for the agents' first answers: never call it on the loop's thread."""
        self._session, self._scheduler, self._listener, self._nodes = session, scheduler, listener, nodes
        # The cluster's nodes may not be known yet: those that turn out to be none of them are given up.
        self.reports = dict(islice(self._ask_all(), MOST_NODES))
        self.gone: set[str] = set()
        """The nodes whose agent was there, has been given up, and has not come back."""
        self._owing: dict[str, object] = {}
        """The last question to each node's agent while it has not answered: earlier ones are not asked again."""
        self._missed: dict[str, DisposableBase] = {}
        self._planned: set[str] = set()
        """The policies that have a source of plans."""
        self._unconfirmed, self._doubts = Unconfirmed(scheduler, self), Doubts()
        self._trials: dict[str, AgentReport] = {}
        """The reports of agents that have yet to confirm a plan before they are counted on."""
        self._proven: set[str] = set()
        """The nodes whose agent has confirmed a plan since it came up."""
        self._failures = AgentFailures(scheduler, listener)
        confirmations = Confirmations(scheduler, self, nodes, self._planned)
        for node in self.reports:
            self._later(partial(self._miss, node))  # until its token is seen: it may have ended since it answered
        self._subscribers: list[Any] = [
            session.liveliness().declare_subscriber(agent_key("*"), directly(self._on_token), history=True),
            session.declare_subscriber(confirmed_key("*"), directly(confirmations.on_sample)),
        ]

    def close(self) -> None:
        """Stop following. Messages already received may still use the session, on the loop."""
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def look(self, node: str) -> None:
        """The cluster has this node now: its agent may live already."""
        self._session.liveliness().get(agent_key(node), directly(self._on_found), timeout=LONG_PATIENCE)

    def expect(self, policy: str, stamp: Stamp, nodes: Iterable[str], standstill: float = 0.0) -> None:
        """A plan was published: each capable agent on `nodes` must confirm it, or a later plan, within BOUND.

        `standstill` is for how many seconds realtime tasks may keep all others from running.
        """
        self._planned.add(policy)
        for node in nodes:
            report = self._trials.get(node) or self.reports.get(node)
            if report is not None and _acts(report):
                self._unconfirmed.expect(node, policy, stamp, BOUND + STANDSTILLS * standstill)

    def failures(self, policy: str) -> dict[str, Mapping[str, str]]:
        """By node, the containers (ID) to which its agent could not give what the policy's last plan says, and why."""
        return self._failures.of(policy)

    def forget(self, policy: str) -> None:
        """Expect no more confirmations for this policy: its source of plans is gone."""
        self._planned.discard(policy)
        self._failures.forget(policy)
        self._unconfirmed.forget(policy)
        self._later(self._end_trials)  # not at once: the policy's next version may be about to publish

    def on_confirmed(self, node: str, said: Confirmation) -> None:
        """Rely on the node's agent, except for the containers that failed."""
        # The policy may have been forgotten while this was on its way.
        if said.policy not in self._planned or node not in self._nodes:
            return
        self._failures.take(node, said)
        self._listener.on_confirmation(node, said)
        self._proven.add(node)
        self._unconfirmed.confirm(node, said.policy, said.stamp)
        self._end_trial(node)

    def on_late(self, node: str) -> None:
        """Stop relying on the node's agent; after a pause, query its capabilities again until it answers."""
        if self._trials.pop(node, None) is None and (
            node not in self.reports or node in self._missed or node in self._owing
        ):
            return
        log.warning("node %s: %s", node, LATE)
        self._proven.discard(node)
        self._ask_later(node, self._doubts.doubt(node, self._now()))
        self._set(node, NOT_CONFIRMING)

    def _try(self, node: str, report: AgentReport) -> None:
        """The node's agent has answered: count on it once it has confirmed the plans in force, if there are any.

        One that is counted on already may be another by now, which has yet to prove itself as well.
        """
        self._trials.pop(node, None)
        if not _acts(report):
            self._set(node, report)
            return
        if _acts(self.reports.get(node, NO_ANSWER)):
            self._set(node, report)
            if node in self._proven or node in self._unconfirmed:
                return
        else:
            self._trials[node] = report
        self._listener.on_trial(node)
        self._end_trial(node)

    def _end_trial(self, node: str) -> None:
        """Rely on the node's agent if it was on trial, and has confirmed all plans that it had to."""
        if node in self._trials and node not in self._unconfirmed:
            self._doubts.trust(node, self._now())
            self._set(node, self._trials.pop(node))

    def _end_trials(self) -> None:
        for node in list(self._trials):
            self._end_trial(node)

    def _ask_all(self) -> Iterator[tuple[str, AgentReport]]:
        # Else Zenoh keeps all answers until the last has come.
        at_once = zenoh.ConsolidationMode.NONE
        for reply in self._session.get(agent_key("*"), timeout=PATIENCE, consolidation=at_once):
            if reply.ok:
                yield node_of(str(reply.ok.key_expr)), read_report(reply.ok.payload.to_bytes())

    def _on_token(self, token: zenoh.Sample) -> None:
        """Zenoh's callbacks must not call Zenoh."""
        node, lives = node_of(str(token.key_expr)), token.kind == zenoh.SampleKind.PUT
        if node in self._nodes or node in self.reports:
            self._later(lambda: self._lives(node) if lives else self._miss(node))

    def _on_found(self, reply: zenoh.Reply) -> None:
        if reply.ok:
            self._on_token(reply.ok)

    def _lives(self, node: str) -> None:
        if node in self._nodes:
            self._ask(node, PATIENCE)

    def _miss(self, node: str) -> None:
        if node not in self._nodes and node not in self.reports:
            return
        self._owing.pop(node, None)
        self._trials.pop(node, None)
        self._proven.discard(node)
        self._forgive(node)
        self._missed[node] = self._scheduler.schedule_relative(RETURN, lambda *_: self._give_up(node))

    def _give_up(self, node: str) -> None:
        """The agent was gone for too long. A new one may be alive already, but has not reported its capabilities."""
        del self._missed[node]
        if node not in self._nodes:
            self._doubts.forget(node)
        elif node not in self._owing:
            self.gone.add(node)
        self._set(node, NO_ANSWER if node in self._owing else None)

    def _forgive(self, node: str) -> None:
        """Cancel the countdown for a missing agent: it is back, or gone again."""
        if node in self._missed:
            self._missed.pop(node).dispose()

    def _ask(self, node: str, patience: float) -> None:
        """Ask one agent until it answers, without blocking.

        A query that times out ends with an error reply, one without any queryable with no reply: `_on_end` sees both.
        """
        question = self._owing[node] = object()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok:
                report = read_report(reply.ok.payload.to_bytes())
                self._later(lambda: self._on_answer(node, report))

        def on_end() -> None:
            self._later(lambda: self._on_end(node, question))

        ended = zenoh.handlers.Callback(on_reply, on_end, indirect=False)
        self._session.get(agent_key(node), ended, timeout=patience, congestion_control=zenoh.CongestionControl.DROP)

    def _on_answer(self, node: str, report: AgentReport) -> None:
        if self._owing.pop(node, None):
            self._forgive(node)
            self._try(node, report)

    def _on_end(self, node: str, question: object) -> None:
        """Ask again if no answer came; until RETURN is over, the report of the agent's predecessor still holds."""
        if self._owing.get(node) is not question:
            return
        if node not in self.reports:
            self._set(node, NO_ANSWER)
        self._ask_later(node, PAUSE)

    def _ask_later(self, node: str, seconds: float) -> None:
        question = self._owing[node] = object()

        def ask(*_: object) -> None:
            if self._owing.get(node) is question:
                self._ask(node, LONG_PATIENCE)

        self._scheduler.schedule_relative(seconds, ask)

    def _set(self, node: str, report: AgentReport | None) -> None:
        before = dict(self.reports)
        if report is None:
            self.reports.pop(node, None)
            self._failures.forget_node(node)
        else:
            self.reports[node] = report
            self.gone.discard(node)
        if self.reports != before:
            self._listener.on_agents()

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)

    def _later(self, action: Callable[[], None]) -> None:
        self._scheduler.schedule(lambda *_: action())


def _acts(report: AgentReport) -> bool:
    """Whether an agent carries out anything: `limits` and `realtime` hold what it lacks."""
    return not (report.limits and report.realtime)
