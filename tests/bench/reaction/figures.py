"""What was measured, and what is reported of it: medians of stages, the three key figures. Pure."""

from __future__ import annotations

import random
import statistics
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    Reaction = dict[str, Any]
    """A `path` with its `stages` in milliseconds, or with what it `missed`."""

IDLE, SATURATED = "idle", "saturated"
RESIZE, AGENT = "operator, resize", "operator, agent"


@dataclass(slots=True)
class Cell:
    """The times of one stage of one path, in milliseconds."""

    node: str
    pods: int
    path: str
    stage: str
    times: list[float] = field(default_factory=list)

    def row(self) -> dict[str, Any]:
        """The cell as the table has it."""
        return {
            "node": self.node,
            "pods": self.pods,
            "path": self.path,
            "stage": self.stage,
            "p50_ms": round(percentile(self.times, 50), 3),
            "p90_ms": round(percentile(self.times, 90), 3),
            "max_ms": round(max(self.times), 3),
            "n": len(self.times),
        }


FIRST = ("first cgroup", "cgroup")
"""The stage at which a path's first limit is in the kernel."""
SAMPLES, CONFIDENCE = 1000, 95


class Figures:
    """Collects the cells of a run."""

    def __init__(self) -> None:
        self._rounds: dict[str, list[float | None]] = {}
        self._cells: dict[tuple[str, int, str, str], Cell] = {}
        self.missed: list[str] = []

    def note(self, node: str, pods: int, reactions: Sequence[Reaction]) -> None:
        """Add the reactions of one case."""
        for reaction in reactions:
            if (node, pods) == (IDLE, 1):
                stages = reaction.get("stages", {})
                at = next((stages[stage] for stage in FIRST if stage in stages), None)
                self._rounds.setdefault(reaction["path"], []).append(at)
            if "missed" in reaction:
                self.missed.append(f"{node}, {pods} pods, {reaction['path']}: {reaction['missed']}")
            for stage, milliseconds in reaction.get("stages", {}).items():
                key = node, pods, reaction["path"], stage
                self._cells.setdefault(key, Cell(*key)).times.append(milliseconds)

    def rows(self) -> list[dict[str, Any]]:
        """The table."""
        return [cell.row() for cell in self._cells.values()]

    def peers(self) -> list[dict[str, Any]]:
        """Sample, or command, to the first limit in the kernel: each path beside ours, paired by rounds."""
        ours = self._rounds.get(RESIZE, [])
        return [
            {"path": path, **_paired([(one, own) for one, own in zip(of, ours, strict=False) if one and own])}
            for path, of in self._rounds.items()
        ]

    def p50(self, node: str, pods: int, path: str, stage: str) -> float | None:
        """A median; None when it was not measured."""
        cell = self._cells.get((node, pods, path, stage))
        return percentile(cell.times, 50) if cell else None

    def keys(self) -> dict[str, float | None]:
        """The key figures, of one pod on the idle node: there each path does exactly the same work."""
        operator = self.p50(IDLE, 1, RESIZE, "first patch accepted")
        patch = self.p50(IDLE, 1, "bare PATCH", "first patch accepted")
        agent = self.p50(IDLE, 1, AGENT, "first cgroup")
        docker = self.p50(IDLE, 1, "docker update", "cgroup")
        write = self.p50(IDLE, 1, "direct cgroup write", "cgroup")
        return {
            "operator_overhead_ms_p50": None if operator is None or patch is None else round(operator - patch, 3),
            "agent_over_docker_update_p50": _ratio(agent, docker),
            "agent_over_cgroup_write_p50": _ratio(agent, write),
        }


def _paired(pairs: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """The median of the first, and of their ratio to the second with its confidence interval, by resampling rounds."""
    if not pairs:
        return {"p50_ms": None, "over_operator": None, "interval": None, "n": 0}
    ratios = [one / other for one, other in pairs]
    chance = random.Random(0)  # noqa: S311 - the same every time, on purpose
    resampled = [statistics.median(chance.choices(ratios, k=len(ratios))) for _ in range(SAMPLES)]
    tail = (100 - CONFIDENCE) / 200
    low, high = (sorted(resampled)[round(part * (SAMPLES - 1))] for part in (tail, 1 - tail))
    return {
        "p50_ms": round(statistics.median(one for one, _ in pairs), 3),
        "over_operator": round(statistics.median(ratios), 3),
        "interval": f"{low:.3f} to {high:.3f}",
        "n": len(pairs),
    }


def medians(reactions: Sequence[Mapping[str, float]], stages: Sequence[str]) -> dict[str, float | None]:
    """The median of each stage; None for one that no reaction got to."""
    times = {stage: [one[stage] for one in reactions if stage in one] for stage in stages}
    return {f"{stage} ms p50": rounded(found, 50) for stage, found in times.items()}


def rounded(times: Sequence[float], percent: int) -> float | None:
    """A percentile for a table; None when nothing was measured."""
    return round(percentile(times, percent), 1) if times else None


def percentile(times: Sequence[float], percent: int) -> float:
    """A percentile, interpolated."""
    if len(times) < 2 or percent == 100:
        return max(times)
    return statistics.quantiles(times, n=100, method="inclusive")[percent - 1]


def _ratio(one: float | None, other: float | None) -> float | None:
    return None if one is None or not other else round(one / other, 3)
