"""A runner with all around it: a session, a loop in virtual time, and what it orders."""

from __future__ import annotations

from contextpolicy.cluster.agent_reports import read_report, with_agents
from contextpolicy.cluster.claims import claim
from contextpolicy.cluster.pods import view
from contextpolicy.policies.policy_runner import PolicyRunner
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import NODE, a_pod
from tests.planning.builders import a_context, a_policy, a_stream, a_task
from tests.virtual_operator import VirtualLoop

IMU, PLAN, APPLIED = "robot/imu", "contextpolicy/lab/robot/plan", "contextpolicy/lab/robot/applied"


class Orders:
    """Notes what is ordered."""

    def __init__(self):
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
        self.changes = []
        self.runner = self.version(**spec)

    def version(self, initiatives=None, **spec):
        defaults = {
            "streams": [a_stream("imu")],
            "tasks": [a_task("slam"), a_task("speech")],
            "contexts": [a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 4}})],
        }
        made = PolicyRunner(
            a_policy(**{**defaults, **spec}),
            session=self.session,
            scheduler=self.loop,
            actuator=self.orders,
            initiatives=initiatives or {},
        )
        made.on_change = lambda: self.changes.append(made)
        return made

    def place(self, *names, cpu=1000, runner=None):
        runner = runner or self.runner
        pods = [view(a_pod(name)) for name in names]
        own = claim([runner.policy], pods, {NODE: cpu})[runner.policy.reference]
        reports = {node: read_report(report) for node, report in self.session.agents.items()}
        runner.place(with_agents(runner.policy, own, reports), pods)

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
