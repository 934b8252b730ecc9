"""The order of writes in which no step breaks a rule of the kernel or gives away more than there is. Pure.

Amounts are thousandths of a core, or of the realtime period; None is no limit.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.planning.allocation.placement import QUANTUM

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Step:
    """One write of a budget."""

    group: Path
    amount: int


@dataclass(frozen=True, slots=True)
class LimitStep:
    """One write of a limit."""

    group: Path
    amount: int | None


@dataclass(frozen=True, slots=True)
class PodLimits:
    """A pod's limit, the sum of its other containers' limits, and (now, wanted) of each container that is ordered.

    `owned`: the limit is the pod's own (`spec.resources`), which only its owner changes.
    """

    group: Path
    now: int | None
    others: int
    containers: Mapping[Path, tuple[int | None, int | None]]
    owned: bool = False

    @property
    def needed(self) -> int | None:
        """The least limit of the pod that does not throttle its containers below theirs; what it has if that stays."""
        if self._stays:
            return self.now
        return self.others + sum(wanted or 0 for _, wanted in self.containers.values())

    @property
    def moves(self) -> Mapping[Path, tuple[int | None, int | None]]:
        """(now, wanted) of each container; what a limit of the pod's own means for it included."""
        if not self._stays:
            return self.containers
        return {group: (now, self._within(now, wanted)) for group, (now, wanted) in self.containers.items()}

    @property
    def _stays(self) -> bool:
        """The kubelet limits a pod of which a container has no limit only if the pod has one of its own."""
        return self.owned or None in [wanted for _, wanted in self.containers.values()]

    def _within(self, now: int | None, wanted: int | None) -> int | None:
        """No more than the pod has, and as much for a container without a limit: the kubelet writes the pod's there.

        The systemd driver may have rounded only one of the two, by less than 10m (kubernetes #129357).
        """
        if wanted is None and now is not None and self.now is not None and 0 <= self.now - now < QUANTUM:
            return now
        return min(wanted, self.now, key=_height)


def limit_steps(pods: Iterable[PodLimits]) -> list[LimitStep]:
    """All decreases, then the increases, each pod before its containers: version 1 refuses a child above its parent.

    A pod's limit only grows here, if it is the sum of its containers'. Too high a limit does no harm, and the resize
    that follows lowers it; lowered at once, it could make a resize fail that is still under way.
    """
    pods = list(pods)
    lower = [LimitStep(c, w) for pod in pods for c, (now, w) in pod.moves.items() if _height(w) < _height(now)]
    higher = []
    for pod in sorted(pods, key=lambda pod: _height(pod.needed)):
        if _height(pod.now) < _height(pod.needed):
            higher.append(LimitStep(pod.group, pod.needed))
        higher += [LimitStep(c, w) for c, (now, w) in pod.moves.items() if _height(w) > _height(now)]
    return lower + higher


def _height(limit: int | None) -> float:
    return inf if limit is None else limit


def budgets(
    leaves: Mapping[Path, int], top: Path, others: Mapping[Path, int], least: Mapping[Path, int]
) -> dict[Path, int]:
    """The realtime budget of each leaf, and of every group above it up to `top`: at least the sum of its children's.

    `others` is the sum of a group's other children, `least` what the group had before any policy.
    """
    wanted: dict[Path, int] = dict(leaves)
    children: dict[Path, set[Path]] = defaultdict(set)
    for leaf in leaves:
        for child, parent in zip([leaf, *leaf.parents], leaf.parents, strict=False):
            children[parent].add(child)
            if parent == top:
                break
    for parent in sorted(children, key=_depth, reverse=True):
        wanted[parent] = max(least.get(parent, 0), others.get(parent, 0) + sum(wanted[c] for c in children[parent]))
    return wanted


def budget_steps(now: Mapping[Path, int], wanted: Mapping[Path, int]) -> list[Step]:
    """All decreases from the leaves up, then the increases from the top down: children never exceed their parent."""
    lower = [group for group in sorted(wanted, key=lambda g: (-_depth(g), g)) if wanted[group] < now[group]]
    higher = [group for group in sorted(wanted, key=lambda g: (_depth(g), g)) if wanted[group] > now[group]]
    return [Step(group, wanted[group]) for group in lower + higher]


def _depth(group: Path) -> int:
    return len(group.parts)
