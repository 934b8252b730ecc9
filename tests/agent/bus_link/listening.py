"""Who hears what an agent hears."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import zenoh
from reactivex import Subject

from contextpolicy.bus.decision_bus import plan_key
from contextpolicy.cluster.agent_reports import Confirmation
from tests.bus.fake_session import FakeSession
from tests.waiting import PATIENCE

KEY, POLICY = plan_key("robot", "delivery"), "robot/delivery"
STAMP, FAILED = (1, 2, 3), {"containerd://a": "Busy"}


class Listener:
    """Notes what it hears."""

    def __init__(self):
        self.events, self._changed = [], threading.Condition()
        self.late: Subject[Confirmation] = Subject()
        self.lacks = []
        self.queries, self.answered = [], []
        """Questions, and how many of them had an answer when a plan was heard."""
        self.reads = 0
        self.in_force = False
        """Whether a plan is, that its source has to say again when it is in doubt."""

    def hear(self, policy, payload, signed):  # noqa: ARG002
        self.answered.append(sum(bool(query.answers) for query in self.queries))
        self._note((policy, payload))
        return Confirmation(policy, STAMP, FAILED) if payload else None

    def refuse(self, error):
        self._note(error.reason)

    def doubt(self, policy):  # noqa: ARG002
        return self.in_force

    def miss(self, policy, payload, signed):  # noqa: ARG002
        self._note((policy, "missed", payload))

    def find_source(self, policy):
        self._note((policy, "found"))

    def lose_source(self, policy):
        self._note((policy, "lost"))

    def usage(self):
        self.reads += 1
        return {"at": 1.0, "containers": {}}

    def report(self):
        return {"missing": {"CFS": [], "Realtime": self.lacks}}

    def on_agents(self):
        self._note("changed")

    def on_confirmation(self, node, said):
        """Confirmations are heard as the agent's bus sends them."""

    def on_trial(self, node):
        """There are no plans that an agent would have to confirm."""

    def expect(self, *events):
        with self._changed:
            assert self._changed.wait_for(lambda: self.events == list(events), PATIENCE), self.events

    def wait(self, number):
        """Until it has heard so many."""
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.events) >= number, PATIENCE), self.events

    def _note(self, event):
        with self._changed:
            self.events.append(event)
            self._changed.notify_all()


class Copied(bytes):
    """What Zenoh hands over."""

    def to_bytes(self):
        return bytes(self)


class Asked(FakeSession):
    """Notes when a source is asked for its plan; no answer arrives."""

    def __init__(self, scheduler):
        super().__init__()
        self.asked: list[tuple[str, float]] = []
        self._scheduler = scheduler
        self.wait = scheduler.advance_by
        self.bus: Any = None

    def get(self, selector, handler=None, *, timeout=10.0, **_):  # noqa: ARG002
        self.asked.append((selector, self._scheduler.clock))

    def put(self, key, payload, **more):
        """What is confirmed."""

    def say(self, payload, attachment=None):
        """Anybody publishes this as a plan."""
        hear: Any = self.subscribers[0].callback
        copied = None if attachment is None else Copied(attachment)
        hear(SimpleNamespace(key_expr=KEY, kind=zenoh.SampleKind.PUT, payload=Copied(payload), attachment=copied))

    def say_token(self, kind):
        watch: Any = self.watchers[0].callback
        watch(SimpleNamespace(key_expr=KEY, kind=kind))
