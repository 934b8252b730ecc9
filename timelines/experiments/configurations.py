"""The ways to divide the CPU that are compared. Pure: each is the chart's values, and a policy or none."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.allocation.shares import Demand, divide
from contextpolicy.policy.quantities import format_cpu, parse_cpu, parse_duration

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    Document = dict[str, Any]

OTHERS = "500m"
"""What operator, router, drivers and guards request, 450m, rounded up."""
PAUSES = ("hold", "enterAfter", "exitAfter")
"""How long something has to last, in contexts and activities."""
UNIT = 10
"""Thousandths of a core: what a CPU quota is counted in."""
REQUESTED = 0.75
"""Part of a static limit that is requested: operator, router and drivers request CPU too, and all pods must fit."""
BASELINE, IDEAL = "linux-default", "ideal"


@dataclass(frozen=True, slots=True)
class Configuration:
    """`resources` gives each container's CPU request and limit; `policy` changes the robot's policy in place.

    Without `policy` the operator is installed, since its router is the bus, but is idle.
    """

    name: str
    title: str
    resources: Callable[[Document, int], Mapping[str, Document]]
    policy: Callable[[Document], None] | None = None
    agent: bool = False
    """Whether the node agent writes the cgroups; the bus then asks everybody who they are."""
    realtime: bool = False
    autoscaled: bool = False
    """Whether a VerticalPodAutoscaler moves requests and limits."""
    alone: bool = False
    """Each task's inputs are played by themselves, one task after the other."""

    def variant(self, document: Document) -> Document | None:
        """The policy to apply; None for Linux's default."""
        if self.policy is None:
            return None
        changed = copy.deepcopy(document)
        self.policy(changed["spec"])
        return changed


def at_pace(document: Document, pace: float) -> Document:
    """The policy for a robot that does all of this `pace` times as fast: pauses are shorter.

    `max` stays: where a task has one, it is what its thread can use, or several times what its inputs cost; more would
    lie idle. `protected` tasks get all of it, since their `min` is what they need at real pace. Silence is judged as
    before: `staleAfter` is about faults, which the story has none of.
    """
    changed = copy.deepcopy(document)
    spec = changed["spec"]
    for task in spec["tasks"]:
        if task.get("protected") and "max" in task:
            task["min"] = task["max"]
    activities = [activity for task in spec["tasks"] for activity in task.get("activity", ())]
    for timed in (*activities, *spec.get("contexts", ())):
        timed |= {name: f"{round(parse_duration(timed[name]) / pace * 1000)}ms" for name in PAUSES if name in timed}
    return changed


def autoscalers(document: Document, cores: int) -> Iterator[Document]:
    """A VerticalPodAutoscaler for each task, in place, within the policy's bounds."""
    for task in document["spec"]["tasks"]:
        name = task["name"]
        bounds = {"minAllowed": {"cpu": task.get("min", "10m")}, "maxAllowed": {"cpu": task.get("max", str(cores))}}
        own = {"containerName": task.get("container", name), "controlledResources": ["cpu"], **bounds}
        yield {
            "apiVersion": "autoscaling.k8s.io/v1",
            "kind": "VerticalPodAutoscaler",
            "metadata": {"name": name, "namespace": document["metadata"]["namespace"]},
            "spec": {
                "targetRef": {"apiVersion": "apps/v1", "kind": "Deployment", "name": name},
                "updatePolicy": {"updateMode": "InPlaceOrRecreate", "minReplicas": 1},
                "resourcePolicy": {"containerPolicies": [own, {"containerName": "*", "mode": "Off"}]},
            },
        }


def _unlimited(document: Document, _cores: int) -> dict[str, Document]:
    return {task["name"]: {"limit": ""} for task in document["spec"]["tasks"]}


def _resizable(document: Document, _cores: int) -> dict[str, Document]:
    """The chart's own: a request of 10m and a limit, which the policy moves."""
    return {task["name"]: {} for task in document["spec"]["tasks"]}


def by_priority(document: Document, cores: int) -> dict[str, Document]:
    """Limits that divide the node by the policy's priorities, within its bounds, once and for all; with requests."""
    spec = document["spec"]
    total = cores * 1000 - parse_cpu(spec.get("reserve", 0))
    claims = [
        Demand(
            task["name"],
            float(task.get("priority", 1)),
            parse_cpu(task.get("min", "10m")) // UNIT,
            parse_cpu(task.get("max", str(cores))) // UNIT,
        )
        for task in spec["tasks"]
    ]
    shares = {name: units * UNIT for name, units in divide(total // UNIT, claims).items()}
    return {
        name: {"request": format_cpu(round(REQUESTED * share)), "limit": format_cpu(share)}
        for name, share in shares.items()
    }


def _as_it_is(_spec: Document) -> None:
    """CFS, limits, and contexts that suspend."""


def _without_suspension(spec: Document) -> None:
    for context in spec.get("contexts", ()):
        context["tasks"] = {name: change for name, change in context["tasks"].items() if "suspend" not in change}
    spec["contexts"] = [context for context in spec.get("contexts", ()) if context["tasks"]]


def _control(control: str) -> Callable[[Document], None]:
    """Shares are requests then, and the kubelet defers what does not fit beside the requests of all other pods."""
    return lambda spec: spec.update(enforcement={"control": control}, reserve=OTHERS)


def _realtime(period: str) -> Callable[[Document], None]:
    return lambda spec: spec.update(enforcement={"scheduler": "Realtime", "period": period})


LINUX_DEFAULT = Configuration(BASELINE, "Linux default", _unlimited)
STATIC = Configuration("static-limits", "static limits", by_priority)
VPA = Configuration("vpa", "VPA in place", by_priority, autoscaled=True)
CFS = Configuration("cfs-ca", "CFS CA", _resizable, _as_it_is)
UNSUSPENDED = Configuration("cfs-ca-unsuspended", "CFS CA, no suspension", _resizable, _without_suspension)
WEIGHT = Configuration("weight", "CFS CA, Weight", _resizable, _control("Weight"))
CFS_AGENT = Configuration("cfs-ca-agent", "CFS CA, agent", _resizable, _as_it_is, agent=True)
RT = Configuration("rt-ca-1s", "RT CA, 1 s", _resizable, _realtime("1s"), agent=True, realtime=True)
RT_SHORT = Configuration("rt-ca-100ms", "RT CA, 100 ms", _resizable, _realtime("100ms"), agent=True, realtime=True)
ALONE = Configuration(IDEAL, "each task alone", _unlimited, alone=True)

MAIN = (LINUX_DEFAULT, STATIC, VPA, CFS, RT)
REST = (UNSUSPENDED, WEIGHT, CFS_AGENT, RT_SHORT)
ALL = (LINUX_DEFAULT, STATIC, VPA, CFS, UNSUSPENDED, WEIGHT, CFS_AGENT, RT, RT_SHORT, ALONE)
"""In the order in which a repeat runs them, so that the operator is reinstalled only once."""
