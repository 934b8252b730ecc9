"""A runner with all around it: a session, a loop in virtual time, and what it orders."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.actuators.dry_run import DryRun
from contextpolicy.bus.questions import Questions
from contextpolicy.bus.signatures import UnsignedPlans
from contextpolicy.cluster.agent_reports import read_report, with_agents
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.policies.policy_runner import PolicyRunner
from contextpolicy.policies.services import Services
from contextpolicy.recorder.flight_recorder import BUDGET, SECONDS, FlightRecorder
from contextpolicy.streams.backlog import PER_STREAM, TOTAL, Backlog
from contextpolicy.streams.retention import POOL, Retention
from contextpolicy.streams.wall_clock import WallClock
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import NODE, a_pod
from tests.cluster.claiming import claim
from tests.planning.builders import a_context, a_policy, a_stream, a_task
from tests.virtual_operator import OpenFence, VirtualLoop

if TYPE_CHECKING:
    from contextpolicy.bus.agent_watch import AgentWatch

IMU, PLAN, APPLIED = "robot/imu", "contextpolicy/lab/robot/plan", "contextpolicy/lab/robot/applied"


class Orders(DryRun):
    """An actuator that notes what is ordered."""

    def __init__(self):
        super().__init__()
        self.all = []

    def apply(self, order):
        self.all.append(order)

    @property
    def last(self):
        return self.all[-1]


class Robot:
    """A runner with all around it."""

    def __init__(self, **spec):
        self.session, self.loop, self.orders = FakeSession(), VirtualLoop(), Orders()
        self.changes, self.plans, self.contexts = 0, [], []
        self.causes: list[str] = []
        self.step = 0.0
        """Seconds by which the machine's clock was set ahead."""
        self.agents: AgentWatch | None = None
        """Who hears which plans agents must confirm; by default nobody does."""
        self.runner = self.version(**spec)

    def version(self, initiatives=None, **spec):
        defaults = {
            "streams": [a_stream("imu")],
            "tasks": [a_task("slam"), a_task("speech")],
            "contexts": [a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 4}})],
        }
        services = Services(
            session=self.session,  # type: ignore[arg-type]  # a fake
            scheduler=self.loop,
            clock=WallClock(self.loop, lambda: self.loop.to_seconds(self.loop.now) + self.step),
            signer=UnsignedPlans(),
            fence=OpenFence(),
            agents=self,
            boards=self,
            recorder=FlightRecorder(BUDGET, SECONDS),
            listener=self,
            backlog=Backlog(PER_STREAM, TOTAL),
            retention=Retention(POOL),
            questions=Questions(self.loop),
            settled=2.0,  # what the times in these tests assume
        )
        return PolicyRunner(a_policy(**{**defaults, **spec}), services, self.orders, initiatives or {}, {})

    def on_change(self, _):
        self.changes += 1

    def on_plan(self, policy, plan, _):
        self.plans.append((policy, plan))

    def on_context(self, _, context, cause, *, active):
        self.contexts.append((context, active))
        self.causes.append(cause)

    def expect(self, *expected):
        if self.agents is not None:
            self.agents.expect(*expected)

    def failures(self, policy):
        return self.agents.failures(policy) if self.agents is not None else {}

    def board(self, policy):
        return {"policy": policy}

    def place(self, *names, cpu=1000):
        pods = [view(a_pod(name)) for name in names]
        own = claim([self.runner.policy], pods, {NODE: cpu})[self.runner.policy.reference]
        reports = {node: read_report(report) for node, report in self.session.agents.items() if report}
        self.runner.place(with_agents(self.runner.policy, own, reports), pods)

    def begin(self):
        self.runner.start()
        self.place("slam", "speech")
        return self

    def sample(self, **value):
        self.session.deliver(IMU, **value)
        self.loop.advance_by(0.01)

    def edit(self, **spec):
        before, self.runner = self.runner, self.version(**spec)
        before.stop()
        self.runner.start(before)
