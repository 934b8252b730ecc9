"""The order in which containers are put back: limits fall before others rise. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.cluster.container_names import container_id

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from contextpolicy.actuators.resize.originals import Original
    from contextpolicy.actuators.resize.pod_state import PodState
    from contextpolicy.actuators.resize.tracked_pod import TrackedPod
    from contextpolicy.cluster.pods import Cpu

RESTORE_PATIENCE = 2.0
"""Seconds for which restored limits wait to rise until others have fallen. Bounded, because a refusal or a dead kubelet
must not block a restore."""


class RestoreOrder:
    """The nodes on which one policy's restored limits wait for others to fall, and since when."""

    def __init__(self, policy: str) -> None:
        self._policy = policy
        self._falling: dict[str, float] = {}

    def bound(
        self, pods: Iterable[TrackedPod], back: Mapping[str, Mapping[str, Cpu]], now: float
    ) -> Mapping[str, float]:
        """The nodes on which no restored limit may rise yet, and until when; `back` is to be put back, by pod UID."""
        if not any(back.values()):
            self._falling = {}
            return {}
        before = self._falling
        nodes = {pod.view.node for pod in pods if is_falling(pod.state, self._policy, back.get(pod.uid, {}))}
        self._falling = {node: before.get(node, now) for node in nodes}
        return {node: since + RESTORE_PATIENCE for node, since in self._falling.items()}


def to_put_back(
    state: PodState, originals: Mapping[str, Original], policy: str, claimed: Collection[str]
) -> dict[str, Cpu]:
    """The originals of the pod's containers that the policy resized and no longer claims, by container name."""
    return {
        name: original.cpu
        for name, original in originals.items()
        if original.policy == policy and container_id(state.view, name) not in claimed
    }


def is_falling(state: PodState, policy: str, back: Mapping[str, Cpu]) -> bool:
    """Whether a container may still have more than its original, or the kubelet has not confirmed lowering it.

    A pod that is being deleted counts until its containers have ended.
    """
    if state.view.ended and not state.view.running:
        return False
    above = any(cpu.limit is not None and state.highest(name) > cpu.limit for name, cpu in back.items())
    return above or policy in state.putting_back.values()


def without_rises(state: PodState, back: Mapping[str, Cpu]) -> dict[str, Cpu]:
    """The part of `back` that raises no limit above the highest that may be in force now."""
    return {name: cpu for name, cpu in back.items() if cpu.limit is None or cpu.limit <= state.highest(name)}
