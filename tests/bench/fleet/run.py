"""What is done to an operator and its fleet, and what each of these phases costs."""

from __future__ import annotations

import json
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from contextpolicy.bus.session import open_router
from tests.bench.fleet.control_plane import ControlPlane
from tests.bench.fleet.measured_operator import Applied, MeasuredOperator
from tests.bench.reaction.figures import percentile
from tests.bench.reaction.site import say
from tests.ports import free_port

if TYPE_CHECKING:
    from collections.abc import Iterator

    import zenoh

    from tests.bench.fleet.crowd import Fleet

QUIET = 20.0
"""Seconds for which an idle operator is watched."""
ROUNDS = 60
PAUSE = 0.4
"""Seconds between two rounds: a newer plan waits 0.3 s for the last resize of a pod."""
CHURN = 1000
SETTLE, CALM, PATIENCE = 1.0, 0.02, 60.0
"""Seconds between looks at what the operator spends, what it spends at most in between when all statuses and Events of
what was done are written, and for how long that is waited for."""

Phase = dict[str, float]


@contextmanager
def started(fleet: Fleet) -> Iterator[Run]:
    """The fleet without its policies on an API server of its own, and the operator."""
    router = f"tcp/127.0.0.1:{free_port()}"
    with ControlPlane() as plane, open_router([router]) as bus:
        say(f"creating {fleet.pods} pods")
        fleet.fill(plane)
        with MeasuredOperator(plane.kubeconfig, router) as operator:
            yield Run(fleet, plane, bus, operator, router)


class Run:
    """The phases, to be called in this order; each may be left out from `patch` and `react` on."""

    def __init__(
        self, fleet: Fleet, plane: ControlPlane, bus: zenoh.Session, operator: MeasuredOperator, router: str
    ) -> None:
        self.bus, self.operator, self.router = bus, operator, router
        self._fleet, self._plane = fleet, plane
        self._applied = Applied(bus)
        self._turns = {fleet.namespace(robot): False for robot in range(fleet.robots)}

    def start(self) -> Phase:
        say("the operator starts")
        listed = self.operator.wait_until_serving()
        cpu, peak = self.operator.cpu(), self.operator.peak()
        return {"listed_after_s": round(listed, 2), "listed_cpu_s": round(cpu, 2), "listed_peak_mib": round(peak, 1)}

    def patch(self, rounds: int) -> Phase:
        """One policy's limits by as many bare PATCHes at once, which nobody decides; before there are policies."""
        say("bare PATCHes")
        took = []
        for number in range(rounds):
            began = time.monotonic()
            self._fleet.resize(self._plane, f"{300 + number % 2}m")
            took.append(time.monotonic() - began)
        return _percentiles("bare_patches_accepted", took)

    def govern(self) -> Phase:
        say("policies come")
        before, began = self.operator.cpu(), time.monotonic()
        self._fleet.govern(self._plane)
        self._applied.wait(self._fleet.limits)
        self._applied.after(self._turn_all, self._fleet.limits)
        took = time.monotonic() - began
        self._calm()
        return {"governed_after_s": round(took, 2), "governed_cpu_s": round(self.operator.cpu() - before, 2)}

    def react(self, rounds: int = ROUNDS) -> Phase:
        """From the sample, one policy at a time, with the CPU of all that follows until the next."""
        say("one policy at a time")
        first, last = [], []
        before = self.operator.cpu()
        for number in range(rounds):
            namespace = self._fleet.namespace(number * 7 % self._fleet.robots)
            moments = self._applied.after(partial(self._turn, namespace), self._fleet.limits_of_one)
            first.append(moments[0])
            last.append(moments[-1])
            time.sleep(PAUSE)
        return {
            **_percentiles("first_patch_accepted", first),
            **_percentiles("all_patches_accepted", last),
            "cpu_ms_per_plan": round((self.operator.cpu() - before) / rounds * 1e3, 2),
        }

    def storm(self) -> Phase:
        say("all policies at once")
        before = self.operator.cpu()
        moments = self._applied.after(self._turn_all, self._fleet.limits)
        self._calm()
        return {
            "storm_first_accepted_ms": round(moments[0] * 1e3, 1),
            "storm_all_accepted_ms": round(moments[-1] * 1e3, 1),
            "storm_cpu_s": round(self.operator.cpu() - before, 2),
        }

    def churn(self) -> Phase:
        say("others' pods change")
        before = self.operator.cpu()
        for number in range(CHURN):
            self._fleet.disturb(self._plane, number)
        self._calm()
        return {"cpu_us_per_foreign_pod_event": round((self.operator.cpu() - before) / CHURN * 1e6)}

    def rest(self, seconds: float = QUIET) -> Phase:
        say("nothing happens")
        before = self.operator.cpu()
        time.sleep(seconds)
        idle = 100 * (self.operator.cpu() - before) / seconds
        resident, peak = self.operator.resident(), self.operator.peak()
        return {"idle_cpu_percent": round(idle, 2), "resident_mib": round(resident, 1), "peak_mib": round(peak, 1)}

    def _calm(self) -> None:
        """Wait until the operator has nothing left to do."""
        deadline, spent = time.monotonic() + PATIENCE, CALM + 1
        while spent > CALM and time.monotonic() < deadline:
            before = self.operator.cpu()
            time.sleep(SETTLE)
            spent = self.operator.cpu() - before

    def _turn_all(self) -> None:
        for namespace in self._turns:
            self._turn(namespace)

    def _turn(self, namespace: str) -> None:
        self._turns[namespace] = not self._turns[namespace]
        self.bus.put(f"{namespace}/turn", json.dumps({"left": self._turns[namespace]}))


def _percentiles(name: str, seconds: list[float]) -> Phase:
    return {
        f"{name}_ms": round(percentile(seconds, 50) * 1e3, 1),
        f"{name}_p90_ms": round(percentile(seconds, 90) * 1e3, 1),
    }
