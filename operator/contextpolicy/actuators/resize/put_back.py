"""In which order containers are put back: what is to fall has fallen before anything rises. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.cluster.claims import container_id

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from contextpolicy.actuators.resize.originals import Original
    from contextpolicy.actuators.resize.pod_state import PodState
    from contextpolicy.cluster.pods import Cpu


def to_put_back(
    state: PodState, originals: Mapping[str, Original], policy: str, claimed: Collection[str]
) -> dict[str, Cpu]:
    """The containers of a pod that the policy keeps the original of and claims no more; and what they had before."""
    return {
        name: original.cpu
        for name, original in originals.items()
        if original.policy == policy and container_id(state.view, name) not in claimed
    }


def is_falling(state: PodState, policy: str, back: Mapping[str, Cpu]) -> bool:
    """Whether a container may still have more than before the policy, or the kubelet is not known to have lowered it.

    In a pod that is being deleted it has that until it has ended.
    """
    if state.view.ended and not state.view.running:
        return False
    above = any(cpu.limit is not None and state.highest(name) > cpu.limit for name, cpu in back.items())
    return above or policy in state.putting_back.values()


def without_rises(state: PodState, back: Mapping[str, Cpu]) -> dict[str, Cpu]:
    """What of it takes no more room than the containers may have now."""
    return {name: cpu for name, cpu in back.items() if cpu.limit is None or cpu.limit <= state.highest(name)}
