"""The whole operator but its watches, in virtual time, on a fake cluster and a fake Zenoh session."""

from __future__ import annotations

import time
from copy import deepcopy
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from reactivex.disposable import Disposable
from reactivex.testing import TestScheduler

from contextpolicy.actuators.resize.stored_originals import Signatures
from contextpolicy.app.wiring import Operator
from contextpolicy.bus.signatures import UnsignedPlans
from contextpolicy.errors import ActuationError
from contextpolicy.policies import plan_publisher, policy_runner, queries
from contextpolicy.policy.tenants import Tenants
from contextpolicy.streams import subscription
from contextpolicy.streams.wall_clock import WallClock
from contextpolicy.telemetry.reporter import STATUS_INTERVAL
from tests.actuators.resize.fake_cluster import FakeCluster
from tests.actuators.resize.rig import MOMENT, Workers
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import NODE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from concurrent.futures import Future

    import pytest
    from reactivex.abc import DisposableBase

START = 1_000_000.0
CLOCKED = (plan_publisher, policy_runner, queries, subscription)
"""What notes when something arrived, was ordered or was published."""


class VirtualLoop(TestScheduler):
    """Time passes only when the test says so."""

    def __init__(self) -> None:
        super().__init__(START)
        self.disposed = self.inline = False

    def schedule(self, action: Any, state: Any = None) -> DisposableBase:
        """At once while somebody blocks until the loop has answered."""
        if self.inline:
            action(self, state)
            return Disposable()
        return super().schedule(action, state)

    def dispose(self) -> None:
        self.disposed = True


class Pool(Workers):
    """An executor that runs its work when the test says so."""

    def __init__(self) -> None:
        super().__init__(apart=False)
        self.ended = False

    def shutdown(self, **_: bool) -> None:
        self.ended = True
        self.jobs.clear()


class ClusterWithPolicies(FakeCluster):
    """Also takes statuses and events."""

    def __init__(self, *pods: dict[str, Any]) -> None:
        super().__init__(*pods)
        self.statuses: dict[str, dict[str, Any]] = {}
        self.events: list[dict[str, Any]] = []
        self.config_maps: dict[str, dict[str, str]] = {}

    def config_map(self, namespace: str, name: str) -> dict[str, str]:
        try:
            return self.config_maps[f"{namespace}/{name}"]
        except KeyError:
            raise ActuationError("NotFound", f'configmaps "{name}" not found (HTTP 404)', retriable=False) from None

    def write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> None:
        self.statuses[f"{namespace}/{name}"] = dict(status)

    def post_event(self, namespace: str, event: Mapping[str, Any]) -> None:  # noqa: ARG002 - the API's signature
        self.events.append(dict(event))


class OpenFence:
    """Lets the operator act everywhere, until it is closed."""

    def __init__(self) -> None:
        self.open = True

    def may_act(self, _: str) -> bool:
        return self.open


class VirtualOperator:
    """An operator that has just started; nothing was listed yet."""

    def __init__(self, *pods: dict[str, Any]) -> None:
        self.cluster, self.session = ClusterWithPolicies(*pods), FakeSession()
        self.tenants, self.fence, self.signatures = Tenants(), OpenFence(), Signatures(b"k" * 32)
        self.agents_everywhere = False
        self.step = 0.0
        """Seconds by which the machine's clock was set ahead."""
        self.start()

    def keep_time(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Let the recorder's clock be virtual too: what is recorded does not depend on how long the test takes."""
        clock = SimpleNamespace(monotonic=lambda: self.loop.to_seconds(self.loop.now), time=time.time)
        for module in CLOCKED:
            monkeypatch.setattr(module, "time", clock)

    def start(self) -> None:
        """Begin again, as after a crash."""
        self.loop, self.patches, self.reports = VirtualLoop(), Pool(), Pool()
        self.operator = Operator(
            self.cluster,
            self.fence,
            self.loop,  # type: ignore[arg-type]
            patches=self.patches,  # type: ignore[arg-type]
            reports=self.reports,  # type: ignore[arg-type]
            signer=UnsignedPlans(),
            signatures=self.signatures,
            tenants=self.tenants,
            clock=WallClock(self.loop, self.wall_time),
            agents_everywhere=self.agents_everywhere,
        )

    def wall_time(self) -> float:
        """What the machine's clock shows: the loop's time until somebody sets it."""
        return self.loop.to_seconds(self.loop.now) + self.step

    def list_all(self, cpu: str = "1") -> None:
        """What the watches report first: nodes and pods."""
        self.node(cpu)
        for uid, feed in self.cluster.feeds.items():
            feed.clear()
            self.operator.pod_changed(self.cluster.pods[uid])
        self.turn()

    def node(
        self, cpu: str = "1", name: str = NODE, uid: str = "", kubelet: str = "v1.36.0", ready: str = "True"
    ) -> None:
        metadata = {"name": name, "uid": uid or f"uid-{name}"}
        conditions = [{"type": "DiskPressure", "status": "False"}, {"type": "Ready", "status": ready}]
        status = {
            "allocatable": {"cpu": cpu},
            "nodeInfo": {"kubeletVersion": kubelet},
            "conditions": conditions,
        }
        self.operator.node_changed({"metadata": metadata, "status": status})
        self.turn()

    def connect(self) -> None:
        self.operator.connected(self.session)  # type: ignore[arg-type]
        self.turn()

    def apply(self, body: dict[str, Any]) -> Future[bool]:
        """The API has the policy, with the originals that were written into its status."""
        reference = f"{body['metadata']['namespace']}/{body['metadata']['name']}"
        stored = self.cluster.policies.setdefault(reference, {})
        body = {**body, "status": {"originals": deepcopy(stored), **(body.get("status") or {})}}
        done = self.operator.policy_changed(body)
        self.turn()
        return done

    def govern(self, body: dict[str, Any]) -> Future[bool]:
        """An operator that knows the cluster and the router gets a policy."""
        self.list_all()
        self.connect()
        return self.apply(body)

    def see(self, reference: str = "lab/robot") -> None:
        """The watch shows a policy as it is now."""
        self.operator.policy_seen(self.cluster.policy(reference))
        self.turn()

    def delete(self, body: dict[str, Any]) -> Future[None]:
        metadata = body["metadata"]
        stored = self.cluster.policies.get(f"{metadata['namespace']}/{metadata['name']}", {})
        done = self.operator.policy_deleted({**body, "status": {"originals": stored}})
        self.turn()
        return done

    def sample(self, key: str, **value: Any) -> None:
        self.session.deliver(key, **value)
        self.turn()

    def react(self, key: str, **value: Any) -> None:
        """A sample comes, and everybody does all that follows from it."""
        self.sample(key, **value)
        self.settle()

    def turn(self, seconds: float = MOMENT) -> None:
        """Let the loop and the reporter work; patches wait."""
        self.loop.advance_by(seconds)
        self.session.answer()
        self.loop.advance_by(MOMENT)
        while self.reports.jobs:
            self.reports.run()
            self.loop.advance_by(MOMENT)

    def close(self) -> None:
        self.loop.inline = True
        self.operator.close()

    def patch(self) -> None:
        """One worker carries its patch out."""
        self.patches.run()
        self.turn()

    def settle(self) -> None:
        """Everybody does all that there is to do; less than a second passes."""
        for _ in range(50):
            while self.patches.jobs:
                self.patch()
            self.cluster.confirm()
            for feed in self.cluster.feeds.values():
                while feed:
                    self.operator.pod_changed(feed.popleft())
            self.turn()
            if not self.patches.jobs:
                self.turn(0.25)
                if not self.patches.jobs:
                    return
        raise AssertionError("never settles")

    def limits(self) -> dict[str, int]:
        return {name: limit for uid in self.cluster.pods for name, limit in self.cluster.limits(uid).items()}

    def resizes_while(self, act: Callable[[], object]) -> list[tuple[str, dict[str, str]]]:
        before = len(self.cluster.resizes())
        act()
        self.settle()
        return self.cluster.resizes()[before:]

    def condition(self, kind: str, policy: str = "lab/robot") -> tuple[str, str, str]:
        """Status, reason and message, once what is news has been written."""
        self.turn(STATUS_INTERVAL)
        [found] = [one for one in self.cluster.statuses[policy]["conditions"] if one["type"] == kind]
        return found["status"], found["reason"], found["message"]

    def reported(self) -> list[tuple[str, str]]:
        return [(event["reason"], event["message"]) for event in self.cluster.events]
