"""The outputs that report a plan but do not act on it: metrics, the log, Events about contexts, the status."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.telemetry import metrics
from contextpolicy.telemetry.logs import log_plan

if TYPE_CHECKING:
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.planner import Planner
    from contextpolicy.policies.services import RunnerListener


class PlanReporter:
    """Reports the plans of one version of a policy, and the samples that were not used."""

    def __init__(self, planner: Planner, listener: RunnerListener) -> None:
        self._planner, self._policy, self._listener = planner, planner.policy, listener
        self._reference = planner.policy.reference
        self._labels = metrics.labels(self._reference)
        self._contexts: tuple[str, ...] = ()
        self._held_back = 0

    def begin(self, before: PlanReporter | None) -> None:
        """Go on from the previous version of the policy, if there was one."""
        if before is not None:
            self._contexts = before._contexts  # noqa: SLF001 - the same class
            metrics.replace(before._policy, self._policy)  # noqa: SLF001 - as above
        metrics.begin(self._reference)

    def report(self, plan: Plan) -> None:
        """Report a new plan."""
        metrics.PLANS.labels(*self._labels).inc()
        metrics.HELD_BACK.labels(*self._labels).inc(self._planner.held_back - self._held_back)
        self._held_back = self._planner.held_back
        log_plan(self._policy, plan)
        self.show()

    def show(self) -> None:
        """Report the weights and contexts of this moment, which may be newer than the plan that is carried out."""
        if self._planner.last is not None:
            metrics.measure(self._policy, self._planner.last)
        self._listener.on_change(self._reference)

    def report_contexts(self, plan: Plan) -> None:
        """Report which contexts began or ceased to hold, and why."""
        for context in self._policy.contexts:
            active = context.name in plan.contexts
            if (context.name in self._contexts) is not active:
                self._listener.on_context(self._reference, context.name, plan.cause, active=active)
        self._contexts = plan.contexts

    def drop(self, stream: str, reason: str) -> None:
        """Report a sample that was not used; the status has only the first of a kind at once."""
        self._planner.on_drop(stream, reason)
        metrics.DROPS.labels(*self._labels, stream, reason).inc()
        if self._planner.drops[stream, reason] == 1:
            self._listener.on_change(self._reference)
