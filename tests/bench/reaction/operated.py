"""The whole path of ours: a sample on Zenoh, a plan, and the limits of all its containers."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from tests.bench.reaction.hearing import Hearing
from tests.bench.reaction.stopwatch import MissedError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import zenoh

    from tests.bench.reaction.stopwatch import Stopwatch
    from timelines.demo.cgroup import Cgroup

PATIENCE, ADOPTION = 10.0, 30.0
EXACT = 1e-6


class Operated:
    """A policy whose plan turns with each sample."""

    def __init__(self, name: str, session: zenoh.Session, namespace: str, stopwatch: Stopwatch) -> None:
        self.name = name
        self._stopwatch = stopwatch
        self._publisher = session.declare_publisher(f"{namespace}/turn", express=True)
        base = f"contextpolicy/{namespace}/bench"
        self._plans, self._applied = Hearing(session, f"{base}/plan"), Hearing(session, f"{base}/applied")
        self._groups: Mapping[str, Cgroup] = {}
        self._left = False
        self._run = 0

    def begin(self, groups: Mapping[str, Cgroup]) -> None:
        """Govern these containers, by id; returns when the policy is in force, after an edit the edited one."""
        self._groups = groups
        deadline = time.monotonic() + ADOPTION
        while not (self._governs(self.turn()) and self._governs(self.turn())):
            if time.monotonic() > deadline:
                raise MissedError(f"{self.name}: no plan for these pods after {ADOPTION:g} s")
        for _ in range(2):
            self.await_limits(began := self.turn())
        self._run = self._plans.since(began)[-1][1]["run"]

    def turn(self) -> float:
        """Publish the next sample; the Unix time of that."""
        self._left = not self._left
        payload = json.dumps({"left": self._left})
        at = time.time()
        self._publisher.put(payload)
        return at

    def turn_to(self, *, left: bool) -> dict[str, float]:
        """Make this the plan in force; the cores of each task in it."""
        if self._left == left:  # the same sample again would make no plan
            self.await_limits(self.turn())
        self.await_limits(began := self.turn())
        return {target["task"]: target["cores"] for target in self._plans.since(began)[-1][1]["targets"]}

    def react(self) -> tuple[float, dict[Cgroup, float]]:
        """Publish the next sample: when that was, and the limits that its plan wants."""
        began = self.turn()
        _, plan = self._plans.wait(_of_sample(began), began, PATIENCE)
        return began, {self._groups[identity]: cores for identity, cores in _cores(plan).items()}

    def go(self) -> dict[str, float]:
        """Milliseconds from a sample to each stage, when all of them are over."""
        before = self._limits()
        began = self.turn()
        planned, plan = self._plans.wait(_of_sample(began), began, PATIENCE)
        wanted = {i: cores for i, cores in _cores(plan).items() if abs(cores - before[i]) > EXACT}
        seen = self._stopwatch.wait({self._groups[i]: cores for i, cores in wanted.items()}, began, PATIENCE)
        lower = [seen[self._groups[i]] for i, cores in wanted.items() if cores < before[i]]
        accepted, in_force = self._resized(wanted, began)
        moments = {  # a plan that only raises limits has no decrease
            "sample at the operator": plan["trigger"],
            "plan on the bus": planned,
            "first patch accepted": accepted,
            "first cgroup": min(seen.values()),
            **({"all decreases": max(lower)} if lower else {}),
            "all cgroups": max(seen.values()),
            "status": in_force,
        }
        return {stage: (at - began) * 1e3 for stage, at in moments.items()}

    def await_limits(self, began: float) -> None:
        """Wait until the kernel has what the newest plan says, which is one of a sample from `began` or later."""
        self._plans.wait(_of_sample(began), began, PATIENCE)
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            wanted = _cores(self._plans.since(began)[-1][1])
            if all(abs(cores - wanted[i]) < EXACT for i, cores in self._limits().items()):
                return
            time.sleep(0.002)

    def plans_since(self, began: float) -> int:
        """How many plans a sample made."""
        return sum(_is_new(plan) for _, plan in self._plans.since(began))

    def resizes_since(self, began: float) -> int:
        """How many resizes the API accepted."""
        return sum(step["stage"] == "accepted" for _, step in self._applied.since(began))

    def close(self) -> None:
        """Leave the bus."""
        for of in (self._plans, self._applied):
            of.close()
        self._publisher.undeclare()

    def _governs(self, began: float) -> bool:
        """Whether the plan that the last sample made, if any, is of the policy that is to be measured."""
        try:
            self._plans.wait(self._is_ours, began, 0.5)
        except MissedError:
            return False
        return True

    def _is_ours(self, plan: Mapping[str, Any]) -> bool:
        return _cores(plan).keys() == self._groups.keys() and int(plan["run"]) > self._run

    def _limits(self) -> dict[str, float]:
        return {identity: group.limit() or 0.0 for identity, group in self._groups.items()}

    def _resized(self, wanted: Mapping[str, float], began: float) -> tuple[float, float]:
        """When the API accepted the first of these limits, and when the status had the last of them."""

        def reported(messages: list[dict[str, Any]], stage: str) -> list[float]:
            own = (m for m in messages if m["time"] >= began)  # what is heard late is of the sample before
            return [m["time"] for m in own if m["stage"] == stage and m["cores"] in wanted.values()]

        def complete(messages: list[dict[str, Any]]) -> bool:
            return min(len(reported(messages, stage)) for stage in ("accepted", "inForce")) >= len(wanted)

        self._applied.await_all(complete, began, PATIENCE)
        messages = [message for _, message in self._applied.since(began)]
        return min(reported(messages, "accepted")), max(reported(messages, "inForce"))


def _cores(plan: Mapping[str, Any]) -> dict[str, float]:
    return {target["containerId"]: target["cores"] for target in plan["targets"]}


def _of_sample(began: float) -> Callable[[Mapping[str, Any]], bool]:
    """Whether a plan is a new one, of a sample from that moment on: one heard late is of the sample before."""
    return lambda plan: _is_new(plan) and plan.get("trigger", 0) >= began


def _is_new(plan: Mapping[str, Any]) -> bool:
    """Whether the message is a new plan, and not the last one again because containers were moved."""
    return int(plan["edition"]) == 0
