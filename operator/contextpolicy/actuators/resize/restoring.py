"""In which order containers are put back: what is to fall has fallen before anything rises. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.cluster.claims import container_id

if TYPE_CHECKING:
    from collections.abc import Collection

    from contextpolicy.actuators.resize.pod_slot import PodSlot
    from contextpolicy.cluster.pods import Cpu


def to_restore(slot: PodSlot, policy: str, claimed: Collection[str]) -> dict[str, Cpu]:
    """The containers of a pod that the policy moved, or is about to, and claims no more; and what they had before."""
    originals = slot.originals
    if slot.job is not None:
        originals |= slot.job.originals
    return {
        name: original.cpu
        for name, original in originals.items()
        if original.policy == policy and container_id(slot.view, name) not in claimed
    }


def falling(slot: PodSlot, policy: str, claimed: Collection[str]) -> bool:
    """Whether a container may still have more than before the policy, or the kubelet is not known to have lowered it.

    In a pod that is being deleted it has that until it has ended.
    """
    if slot.view.ended and not slot.view.running:
        return False
    back = to_restore(slot, policy, claimed)
    return policy in slot.lowered.values() or any(_above(slot.highest(name), cpu.limit) for name, cpu in back.items())


def without_rises(slot: PodSlot, back: dict[str, Cpu]) -> dict[str, Cpu]:
    """What of it takes no more room than the containers may have now."""
    return {name: cpu for name, cpu in back.items() if cpu.limit is None or cpu.limit <= slot.highest(name)}


def _above(highest: int, limit: int | None) -> bool:
    return limit is not None and highest > limit
