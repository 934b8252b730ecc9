"""What all running policies of an operator share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import zenoh
    from reactivex.abc import SchedulerBase

    from contextpolicy.bus.questions import Questions
    from contextpolicy.bus.signatures import PlanSigner
    from contextpolicy.cluster.agent_reports import Stamp
    from contextpolicy.cluster.fencing import Fence
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.recorder.flight_recorder import FlightRecorder
    from contextpolicy.streams.backlog import Backlog
    from contextpolicy.streams.retention import Retention
    from contextpolicy.streams.subscription import Waiting
    from contextpolicy.streams.wall_clock import WallClock


class RunnerListener(Protocol):
    """Receives news of a running policy, by its reference."""

    def on_change(self, policy: str) -> None:
        """Its status has changed."""

    def on_plan(self, policy: str, plan: Plan, ordered: float) -> None:
        """It has a new plan, which was `ordered` at this time, in monotonic seconds."""

    def on_context(self, policy: str, context: str, cause: str, *, active: bool) -> None:
        """A context began or ceased to hold."""


class Agents(Protocol):
    """Receives plans that agents must confirm."""

    def expect(self, policy: str, stamp: Stamp, nodes: Iterable[str], standstill: float) -> None:
        """A plan was published; its tasks may keep all others from running for `standstill` seconds."""

    def failures(self, policy: str) -> Mapping[str, Mapping[str, str]]:
        """By node, the containers (ID) that its agent could not set, and why."""


class Boards(Protocol):
    """What a policy's board shows."""

    def board(self, policy: str) -> dict[str, Any]:
        """The policy as it is now."""


@dataclass(frozen=True, slots=True)
class Services:
    """Agents act on plans only if the `signer` signs them; `clock` is what times on the bus are given by.

    `settled` is for how many seconds a plan has to stay the same before the API follows an agent.
    """

    session: zenoh.Session
    scheduler: SchedulerBase
    clock: WallClock
    signer: PlanSigner
    fence: Fence
    agents: Agents
    boards: Boards
    recorder: FlightRecorder
    listener: RunnerListener
    backlog: Backlog[Waiting]
    retention: Retention
    questions: Questions
    settled: float
