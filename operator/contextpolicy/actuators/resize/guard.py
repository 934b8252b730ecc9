"""Recognise that somebody else has resized a container of a policy, tell it, and remember it for a while."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.contest import REMEMBERED, Contest, Governed
from contextpolicy.cluster.claims import container_id
from contextpolicy.cluster.pods import Cpu
from contextpolicy.cluster.writers import FIELD_MANAGER

if TYPE_CHECKING:
    from collections.abc import Callable

    from reactivex.abc import SchedulerBase

    from contextpolicy.actuators.resize.pod_slot import PodSlot
    from contextpolicy.cluster.pods import ContainerView


class Guard:
    """Looks at every container that a policy decides about.

    `tell` is called with a policy, a container and what was done to it, or None when that is history; `wake` with the
    seconds after which it may be put back.
    """

    def __init__(
        self,
        scheduler: SchedulerBase,
        tell: Callable[[str, str, Contest | None], None],
        wake: Callable[[float], None],
    ) -> None:
        self._scheduler, self._tell, self._wake = scheduler, tell, wake

    def look(self, policy: str, slot: PodSlot, container: ContainerView, wanted: Cpu) -> None:
        """Compare what the container has with what its policy last gave it."""
        spec = slot.spec(container.name)
        if slot.job is not None or spec is None:
            return
        governed = slot.governed.get(container.name)
        if governed is None:
            had = _given(slot, container)
            if had is None and spec != wanted:
                return
            governed = slot.governed[container.name] = Governed(policy, had or spec)
        if spec in (wanted, governed.cpu):
            governed.give(policy, spec)
        elif governed.look(spec, self._now()):
            self._struck(container_id(slot.view, container.name), container, governed, spec)

    def _struck(self, identity: str, container: ContainerView, governed: Governed, spec: Cpu) -> None:
        by = container.writers.limit if spec.limit != governed.cpu.limit else container.writers.request
        self._tell(governed.policy, identity, Contest(by, governed.cpu, spec))
        self._wake(governed.until - self._now())
        if not governed.told:
            governed.told = True
            self._remember(identity, governed, REMEMBERED)

    def _remember(self, identity: str, governed: Governed, seconds: float) -> None:
        self._scheduler.schedule_relative(seconds, lambda *_: self._forget(identity, governed))

    def _forget(self, identity: str, governed: Governed) -> None:
        rest = governed.seen + REMEMBERED - self._now()
        if rest > 1.0:
            self._remember(identity, governed, rest)
        else:
            governed.told = False
            self._tell(governed.policy, identity, None)

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)


def _given(slot: PodSlot, container: ContainerView) -> Cpu | None:
    """What an operator before this one last gave it: where others wrote since, what was there before all of us."""
    original = slot.originals.get(container.name)
    if original is None:
        return None
    ours, spec = ("", FIELD_MANAGER), container.spec
    return Cpu(
        spec.request if container.writers.request in ours else original.cpu.request,
        spec.limit if container.writers.limit in ours else original.cpu.limit,
    )
