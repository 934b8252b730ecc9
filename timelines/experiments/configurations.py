"""The ways to divide the CPU that are compared. Pure: each is the chart's values, and a policy or none.

Gating is a factor of its own: with it the same modules pause in the same contexts under every division. Under a
division that knows no contexts the policy only says what it would do (DryRun), and `gate.py` passes that on to the
modules.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    Document = dict[str, Any]

ROOM = 0.5
"""Part of the node that static weights are spread over: operator, router, drivers and guards request CPU too."""
LEAST = 10
"""Thousandths of a core: the smallest request, as the chart has it."""


STRICTER = 3
"""Times by which contexts weigh more where a policy for weights is enforced by limits: CPU that others leave idle does
not go to the critical task there. Chosen on two tuning stories (`preparation/tuning-limits`)."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """`control` is the policy's, empty where nothing moves with the context; `static` are searched weights.

    With `agent` the node agent writes the cgroups, and the API follows after `settle` seconds (None: the chart's
    default). `adaptive` modules do less for an input when they are late. `alone`: each task's inputs are played by
    themselves, one task after the other. `realtime`: shares are parts of each processor's period (Eq. 2).
    """

    name: str
    title: str
    control: str = ""
    gated: bool = False
    agent: bool = False
    settle: float | None = None
    static: bool = False
    adaptive: bool = False
    alone: bool = False
    realtime: bool = False

    @property
    def contextual(self) -> bool:
        """Whether CPU moves with the context."""
        return bool(self.control) or self.realtime

    @property
    def relayed(self) -> bool:
        """Whether the modules receive the decisions of a policy that does not act."""
        return self.gated and not self.contextual

    def variant(self, document: Document, reserve: str) -> Document | None:
        """The policy to apply; None where none is. `reserve` is what it must not divide."""
        if not self.contextual and not self.gated:
            return None
        changed = copy.deepcopy(document)
        spec = changed["spec"]
        spec["reserve"] = reserve
        if not self.contextual:
            spec["mode"] = "DryRun"
        if self.control == "Limit" and spec.get("enforcement", {}).get("control") != "Limit":
            _weigh_more(spec)
        spec["enforcement"] = {"control": self.control} if self.control else {}
        if self.realtime:
            spec["enforcement"] = {"scheduler": "Realtime", "realtimeFallback": "None"}
        if self.control == "Weight":
            _without_max(spec)
        if not self.gated:
            _without_suspension(spec)
        return changed

    def resources(self, document: Document, cores: int, weights: Mapping[str, int]) -> dict[str, Document]:
        """Each container's CPU request and limit; `weights` are the searched ones.

        A policy resizes a limit that is there, so there is one that does not bind; all others have none.
        """
        names = [task["name"] for task in document["spec"]["tasks"]]
        if self.static:
            return {name: {"request": request, "limit": ""} for name, request in requests(weights, cores).items()}
        return {name: {"limit": str(cores) if self.contextual else ""} for name in names}


def requests(weights: Mapping[str, int], cores: int) -> dict[str, str]:
    """Weights as CPU requests, which is how a pod gets them, in their proportions."""
    room, whole = ROOM * cores * 1000, sum(weights.values())
    return {name: format_cpu(max(LEAST, round(room * weight / whole))) for name, weight in weights.items()}


def _weigh_more(spec: Document) -> None:
    for change in (change for context in spec.get("contexts", ()) for change in context["tasks"].values()):
        if "weight" in change:
            change["weight"] *= STRICTER


def _without_max(spec: Document) -> None:
    """Under weights a `max` would be a quota: what is idle stays usable without."""
    for task in spec["tasks"]:
        task.pop("max", None)


def _without_suspension(spec: Document) -> None:
    for context in spec.get("contexts", ()):
        context["tasks"] = {
            name: {what: value for what, value in change.items() if what != "suspend"}
            for name, change in context["tasks"].items()
            if not change.get("suspend")
        }
    spec["contexts"] = [context for context in spec.get("contexts", ()) if context["tasks"]]


LINUX = Configuration("linux", "Linux default")
LINUX_GATED = Configuration("linux-gated", "Linux default, gated", gated=True)
STATIC = Configuration("static", "static weights", static=True)
STATIC_GATED = Configuration("static-gated", "static weights, gated", static=True, gated=True)
WEIGHTS = Configuration("weights", "context weights", "Weight", agent=True)
WEIGHTS_GATED = Configuration("weights-gated", "context weights, gated", "Weight", agent=True, gated=True)
LIMITS = Configuration("limits", "context limits", "Limit", agent=True)
LIMITS_GATED = Configuration("limits-gated", "context limits, gated", "Limit", agent=True, gated=True)
RESIZED = Configuration("limits-resized", "context limits by resize, gated", "Limit", gated=True)
LINUX_ADAPTIVE = Configuration("linux-adaptive", "Linux default, gated, adaptive", gated=True, adaptive=True)
WEIGHTS_ADAPTIVE = Configuration(
    "weights-adaptive", "context weights, gated, adaptive", "Weight", agent=True, gated=True, adaptive=True
)
WEIGHTS_AT_ONCE = Configuration(
    "weights-at-once", "context weights, gated, API after 2 s", "Weight", agent=True, gated=True, settle=2.0
)
REALTIME = Configuration("realtime", "context realtime, gated", agent=True, gated=True, realtime=True)
ALONE = Configuration("alone", "each task alone", alone=True)

FACTORS: Sequence[Configuration] = (
    *(LINUX, LINUX_GATED, STATIC, STATIC_GATED),
    *(WEIGHTS, WEIGHTS_GATED, LIMITS, LIMITS_GATED, RESIZED),
)
"""Under heavy load: with and without gating, four divisions, and limits by the mission's own path as well."""
DIVISIONS: Sequence[Configuration] = (LINUX, STATIC, WEIGHTS, LIMITS)
"""The four divisions alone, nothing suspended."""
VARIANTS: Sequence[Configuration] = (LINUX_ADAPTIVE, WEIGHTS_ADAPTIVE, WEIGHTS_AT_ONCE)
"""Modules that do less when they are late; an API that follows within contexts, which are shorter than the default."""
FIRST_LAW: Sequence[Configuration] = (LINUX, STATIC, WEIGHTS, WEIGHTS_GATED, LIMITS_GATED)
"""Under light load: the product against plain Linux, as it is used, and without what suspensions leave to others."""
PAPERS: Sequence[Configuration] = (LINUX, LINUX_GATED, WEIGHTS_GATED, LIMITS_GATED, RESIZED)
"""Gated Linux default shows how much of a shorter total time is work that was not done."""
CONFIGURATIONS: Mapping[str, Configuration] = {one.name: one for one in (*FACTORS, *VARIANTS, REALTIME, ALONE)}
