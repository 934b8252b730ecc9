"""Queries of a running operator: boards, plans, explanations, recordings, and everything for a scrape."""

from __future__ import annotations

import json
import time
from functools import cached_property
from typing import TYPE_CHECKING, Any

from contextpolicy.live.board import Alive, board
from contextpolicy.planning.conditions.timers import SAME_INSTANT
from contextpolicy.recorder.recording import bare, recording
from contextpolicy.streams.loop import on_loop
from contextpolicy.telemetry.scrape import Scraped, ScrapedPolicy

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.bus.robot_bus import RobotBus
    from contextpolicy.cluster.nodes import NodeView
    from contextpolicy.cluster.pod_directory import PodDirectory
    from contextpolicy.policies.registry import PolicyRegistry
    from contextpolicy.policy.spec import Policy
    from contextpolicy.recorder.flight_recorder import FlightRecorder, Records
    from contextpolicy.streams.loop import Loop
    from contextpolicy.streams.wall_clock import WallClock
    from contextpolicy.telemetry.resize_watch import ResizeWatch

PATIENCE = 5.0
"""Seconds that people who watch, and scrapes, wait for the loop."""


class Queries:
    """Changes nothing. All but `board` may be called from any thread but the loop's, and wait for the loop."""

    def __init__(  # noqa: PLR0913 - all that there is to see
        self,
        loop: Loop,
        registry: PolicyRegistry,
        bus: RobotBus,
        *,
        pods: PodDirectory,
        nodes: Mapping[str, NodeView],
        resizes: ResizeWatch,
        recorder: FlightRecorder,
        clock: WallClock,
        agents_everywhere: bool,
    ) -> None:
        self._loop, self._registry, self._bus = loop, registry, bus
        self._pods, self._nodes, self._resizes, self._recorder = pods, nodes, resizes, recorder
        self._clock, self._agents_everywhere = clock, agents_everywhere

    def scrape(self) -> Scraped | None:
        """Everything as it is now, for the metrics; None when the loop does not answer."""
        try:
            return on_loop(self._loop, self._scrape).result(PATIENCE)
        except TimeoutError:
            return None

    def boards(self) -> list[dict[str, Any]]:
        """All policies as they are now (see `live.board`); TimeoutError when the loop does not answer."""
        policies = self._registry.present
        return on_loop(self._loop, lambda: [self.board(reference) for reference in sorted(policies)]).result(PATIENCE)

    def plans(self, policy: str, since: float) -> list[dict[str, Any]]:
        """The plans of a policy that were recorded, or ended, after `since`.

        Each has when it was `published`, and `until` when it was in force; null: until the next one. In Unix seconds.
        """
        ahead = self._ahead - self._clock.ahead
        moment = since - ahead + SAME_INSTANT
        records = on_loop(self._loop, lambda: list(self._recorder.plans_since(policy, moment)))
        return [
            {
                **json.loads(plan.payload),
                "published": plan.published + ahead,
                "until": None if plan.until is None else plan.until + ahead,
            }
            for plan in records.result(PATIENCE)
        ]

    def explanation(self, policy: str) -> dict[str, Any] | None:
        """Why each task of a policy has its share; None when no version of it runs."""
        return on_loop(self._loop, lambda: self._explain(policy)).result(PATIENCE)

    def recording(self, policy: str, last: float) -> dict[str, Any] | None:
        """The last seconds of a policy, and the policy itself; None when no version of it runs."""
        found = on_loop(self._loop, lambda: self._recorded(policy)).result(PATIENCE)
        if found is None:
            return None
        body, running, records = found
        # Not on the loop: it may decode tens of thousands of samples.
        return {"policy": bare(body), **recording(running, records, time.monotonic(), last)}

    def board(self, reference: str) -> dict[str, Any]:
        """A policy as it is now; only on the loop's thread."""
        entry = self._registry.present[reference]
        return board(
            Alive(
                policy=reference,
                uid=entry.body["metadata"].get("uid", ""),
                now=self._now(),
                ahead=self._clock.ahead,
                conditions=entry.conditions,
                planner=entry.runner.planner if entry.runner else None,
                plan=entry.runner.message() if entry.runner else None,
                reactions=self._resizes.recent(reference),
                usage=self._bus.usage(),
            )
        )

    def _scrape(self) -> Scraped:
        leaving = self._registry.leaving.items()
        return Scraped(
            now=self._now(),
            connected=self._bus.connected,
            policies=[
                ScrapedPolicy(reference, entry.conditions, entry.runner.held if entry.runner else None)
                for reference, entry in self._registry.present.items()
            ]
            + [ScrapedPolicy(reference, entry.conditions, None) for reference, entry in leaving],
            pods=[pod for namespace in self._registry.namespaces() for pod in self._pods.of(namespace)],
            agents=dict(self._bus.reports),
            nodes=list(self._nodes.values()),
            gone=set(self._bus.gone),
            agents_everywhere=self._agents_everywhere,
        )

    def _explain(self, reference: str) -> dict[str, Any] | None:
        runner = self._registry.runner(reference)
        return runner.explain() if runner is not None else None

    def _recorded(self, reference: str) -> tuple[Mapping[str, Any], Policy, Records] | None:
        entry, records = self._registry.present.get(reference), self._recorder.of(reference)
        if entry is None or entry.runner is None or records is None:
            return None
        return entry.in_force, entry.runner.policy, records.copy()

    @cached_property
    def _ahead(self) -> float:
        """By how many seconds the loop's time is ahead of the monotonic one, always.

        Found each time, it would differ by the time between two readings, and a plan that a page has would come again.
        """
        return self._now() - time.monotonic()

    def _now(self) -> float:
        return self._loop.to_seconds(self._loop.now)
