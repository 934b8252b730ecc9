"""A reporter, and the API server that it writes to."""

from __future__ import annotations

from reactivex.testing import TestScheduler

from contextpolicy.telemetry.reporter import Reporter
from tests.virtual_operator import Pool

POLICY = "lab/robot"


class Desk:
    """A reporter with its worker and the API that it writes to."""

    def __init__(self):
        self.scheduler, self.worker = TestScheduler(), Pool()
        self.statuses, self.events, self.faults = [], [], []
        self.made = 0
        self.reporter = Reporter(self, self.scheduler, self.worker)  # type: ignore[arg-type]  # it only submits

    def write_status(self, namespace, name, status):
        self._fail()
        self.statuses.append((self.now(), f"{namespace}/{name}", status["n"]))

    def post_event(self, namespace, event):
        self._fail()
        self.events.append((namespace, event["reason"], event["message"]))

    def _fail(self):
        if self.faults:
            raise self.faults.pop(0)

    def now(self):
        return round(self.scheduler.to_seconds(self.scheduler.now), 2)

    def status(self, n, policy=POLICY, *, contexts="-", ready="True"):
        conditions = [{"type": "Ready", "status": ready, "reason": "", "message": str(n)}]

        def make():
            self.made += 1
            return {"n": n, "contexts": contexts, "conditions": conditions}

        self.reporter.status(policy, make)

    def storm(self, seconds, *, contexts=("-",)):
        """Eight statuses a second, these contexts in turn."""
        for turn in range(seconds * 8):
            self.status(turn, contexts=contexts[turn % len(contexts)])
            self.wait(0.12)

    def event(self, message):
        self.reporter.event({"metadata": {"namespace": "lab"}, "reason": "Invalid", "message": message})

    def wait(self, seconds):
        """In steps of 10 ms, the worker at work."""
        for _ in range(round(seconds * 100)):
            while self.worker.jobs:
                self.worker.run()
            self.scheduler.advance_by(0.01)
