"""A pod as the operator sees it: what can be resized, and what the kubelet reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.cluster.writers import NOBODY, Writers
from contextpolicy.planning.allocation.placement import QUANTUM

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.owner_references import Owner


class Cpu(NamedTuple):
    """A container's CPU request and limit in thousandths of a core; None where it has none."""

    request: int | None
    limit: int | None


@dataclass(frozen=True, slots=True)
class ContainerView:
    """One container; `actual` is what the kubelet reports as in force, None before it runs.

    `allocated` is the request that the kubelet has granted, as specified; `actual` is read back from the kernel, and
    so is rounded. CPU amounts are thousandths of a core, memory is in bytes.
    """

    name: str
    list_field: str
    spec: Cpu
    actual: Cpu | None
    memory_request: int | None
    memory_limit: int | None
    container_id: str
    allocated: int | None = None
    writers: Writers = NOBODY
    restarts: bool = False
    """Whether its `resizePolicy` makes the kubelet restart it whenever its CPU changes."""
    probed: bool = False
    """Whether it has a livenessProbe, so that the kubelet kills it when it does not answer in time."""

    @property
    def in_force(self) -> bool:
        """Whether the limit in the API is in force, up to the systemd driver's steps of 10m (runc #4622)."""
        return self.actual is None or _steps(self.actual.limit) == _steps(self.spec.limit)

    @property
    def granted(self) -> bool:
        """Whether the request and the limit in the API are in force."""
        return self.in_force and self.allocated in (None, self.spec.request)

    @property
    def admitted(self) -> int:
        """The request that the kubelet keeps room for; more may be written, and deferred or refused for ever."""
        request = self.spec.request or 0
        if self.allocated is None:
            return request if self.container_id else 0
        return min(request, self.allocated)

    @property
    def kept(self) -> int:
        """The request that counts beside others': what the kubelet has granted, or before it has seen the pod, all."""
        return self.admitted if self.allocated is not None else self.spec.request or 0


@dataclass(frozen=True, slots=True)
class PodView:
    """One pod."""

    namespace: str
    name: str
    uid: str
    node: str
    labels: Mapping[str, str]
    qos: str
    mirror: bool
    containers: tuple[ContainerView, ...]
    generation: int
    observed_generation: int | None
    pending: str
    resizing: bool
    """Whether the kubelet reports that a resize is in progress."""
    ended: bool
    running: bool
    """Whether a container still runs; in a pod that is being deleted they may until the grace period ends."""
    version: int
    """The object's resourceVersion, which only grows, so a lower one means an older view. 0 when it is not a number."""
    reserved: int
    """The CPU request that it has at least, whatever its long-running containers have: that of its init containers at
    their peak, or its own (KEP-2837)."""
    overhead: int
    """What its runtime class adds to its CPU request."""
    owner: Owner | None = None
    """Its controller."""
    pooled: bool = False
    """Whether the pod as a whole has CPU resources (`spec.resources`, KEP-2837), which its containers share."""
    limit: int | None = None
    """The CPU limit of the pod as a whole; None where it has none but those of its containers."""
    by_name: Mapping[str, ContainerView] = field(init=False, repr=False, compare=False)
    """The containers, by name."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_name", {container.name: container for container in self.containers})

    @property
    def admitted(self) -> bool:
        """Whether its kubelet has let it in, as its containers show; who may make pods can name any node in them."""
        return self.running or (not self.ended and any(container.container_id for container in self.containers))

    @property
    def seen(self) -> bool:
        """Whether the kubelet has seen the newest spec; True where it does not report that (before Kubernetes 1.34)."""
        return self.observed_generation is None or self.observed_generation >= self.generation

    @property
    def overlooked(self) -> bool:
        """Whether the kubelet has seen the newest spec, but has other resources in force and reports no reason."""
        silent = not (self.pending or self.resizing or self.ended) and self.observed_generation is not None
        return silent and self.seen and not all(container.granted for container in self.containers)

    def floor(self, container: ContainerView, original: Cpu | None = None) -> int:
        """The least limit that the container's request allows where only limits move; 0 where both move together.

        The request that counts is the one before us, in `original`. Where a limit equal to the request could turn the
        pod Guaranteed, the floor is just above it.
        """
        if self.qos == "Guaranteed":
            return 0
        cpu = original or container.spec
        request = cpu.request or 0
        equal_memory = container.memory_limit is not None and container.memory_request == container.memory_limit
        return request + 1 if equal_memory and cpu.request != cpu.limit else request

    def obstacle(self, container: ContainerView, *, may_restart: bool = False, agent: bool = False) -> str | None:
        """Why this container's CPU can't be changed in place, with what to do about it; None when it can.

        `may_restart`: its task accepts that a resize restarts it, if that is what its `resizePolicy` says. `agent`: its
        node has one, which needs no limit in the API: it writes the cgroup's, and takes it back.
        """
        if self.mirror:
            return f"{self.name} is a static pod, which can't be resized; run it as a Deployment"
        if container.spec.limit is None and agent:
            return None
        if self.qos == "BestEffort":
            return f"{self.name} is BestEffort, which can't be resized; give {container.name} a CPU request and limit"
        if container.spec.limit is None:
            return self._without_limit(container)
        if container.restarts and not may_restart:
            return (
                f"{self.name}/{container.name} restarts whenever its CPU changes (resizePolicy RestartContainer); "
                "set NotRequired in its pod template, or accept restarts with restartOnResize: true on its task"
            )
        return None

    def waits_for_request(self, container: ContainerView) -> str | None:
        """Why what the container requests is not known to be its own, with what to do about it; None when it is."""
        request, granted = container.spec.request or 0, container.allocated
        if granted is None or request <= granted:
            return None
        return (
            f"{self.name}/{container.name} requests {request}m, and the kubelet has granted {granted}m"
            f"{f' ({self.pending})' if self.pending else ''}; request what its node has room for"
        )

    def _without_limit(self, container: ContainerView) -> str:
        whose = f"{self.name}/{container.name}"
        if self.pooled:
            return (
                f"{whose} has no CPU limit of its own, only its pod as a whole has one (spec.resources), which "
                f"policies don't move; give {container.name} a CPU request and limit in its pod template, within the "
                "pod's, or run the node agent on its node"
            )
        return (
            f"{whose} has no CPU limit, and Kubernetes can't remove one once it is set; "
            "give it a CPU limit in its pod template, or run the node agent on its node"
        )

    def unweighted(self, container: ContainerView) -> str | None:
        """Why this container can't have a weight of its own, with what to do about it; None when it can."""
        remedies = {"BestEffort": "a CPU request", "Guaranteed": "a CPU request below its limit"}
        if self.qos not in remedies:
            return None
        return (
            f"{self.name} is {self.qos}, and weights compare only among Burstable pods; "
            f"give {container.name} {remedies[self.qos]}"
        )


def _steps(limit: int | None) -> int:
    return -(-(limit or 0) // QUANTUM)
