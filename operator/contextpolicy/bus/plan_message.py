"""A plan as one JSON message of the decision bus: what each container gets, and where agents find it. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.bus.target_weights import fit_weights
from contextpolicy.cluster.container_names import container_id
from contextpolicy.planning.allocation.enforcement import amounts
from contextpolicy.planning.plan_json import plan_json
from contextpolicy.policy.spec import Control, Scheduler

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from contextpolicy.cluster.pods import ContainerView, PodView
    from contextpolicy.planning.allocation.enforcement import Amounts
    from contextpolicy.planning.allocation.placement import Container
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy

LARGEST_PLAN = 4 << 20
"""Bytes: a plan for 5,000 containers has half of that. Agents do not even copy what is larger."""
MOST_CORES = 1024
"""Cores: no node has more. A larger limit, such as a `1500` that lacks its `m`, is sent as this: it binds nowhere."""


def message(  # noqa: PLR0913, PLR0917 - all that a message says
    policy: Policy,
    run: int,
    plan: Plan,
    containers: Iterable[Container],
    pods: Iterable[PodView],
    most_weight: Mapping[str, int],
) -> dict[str, Any]:
    """A plan as the bus carries it (see `plan_json`), without `edition` and `trigger`: the publisher adds those.

    `most_weight` is what the weights may add up to, by node.
    """
    targets = fit_weights(policy, list(_targets(policy, plan, containers, pods)), most_weight)
    return {**plan_json(policy, plan), "run": run, "targets": targets}


def _targets(
    policy: Policy, plan: Plan, containers: Iterable[Container], pods: Iterable[PodView]
) -> Iterator[dict[str, Any]]:
    """What each container of the plan gets."""
    shares = plan.containers
    tasks = {container.id: container for container in containers if container.id in shares}
    specs = {task.name: task for task in policy.tasks}
    count: dict[tuple[str, str], int] = {}
    for one in tasks.values():
        count[one.node, one.task] = count.get((one.node, one.task), 0) + 1
    # There an agent writes quotas for suspended tasks only.
    realtime = {name for name, node in plan.nodes.items() if node.scheduler is Scheduler.REALTIME}
    for pod in pods:
        control = Control.SUSPEND if pod.node in realtime else policy.enforcement.control
        for container in pod.containers:
            claimed = tasks.get(container_id(pod, container.name))
            if claimed is None:
                continue
            # A pod may have come back under its name on a node that the plan does not have.
            node = plan.nodes.get(claimed.node)
            own = amounts(
                control,
                specs[claimed.task],
                shares[claimed.id],
                suspended=plan.tasks[claimed.task].suspended,
                cap=node.caps.get(claimed.task) if node and node.caps else None,
                containers=count[claimed.node, claimed.task],
            )
            yield _target(pod, container, claimed, shares[claimed.id], own)


def _target(pod: PodView, container: ContainerView, claimed: Container, share: int, own: Amounts) -> dict[str, Any]:
    """What one container gets, with everything an agent on its node needs to find the cgroup."""
    quota = _quota(claimed, own.quota)
    return {
        "task": claimed.task,
        "node": pod.node,
        "namespace": pod.namespace,
        "pod": pod.name,
        "uid": pod.uid,
        "qos": pod.qos,
        "container": container.name,
        "containerId": container.container_id,
        "cores": share / 1000,
        "weight": None if own.weight is None or pod.qos != "Burstable" else own.weight / 1000,
        "quota": _cores(quota),
        "held": _is_held(claimed, quota),
        "original": _cores(claimed.limit),
        "podLimit": _cores(pod.limit),
        "request": _cores(container.spec.request if container.allocated is None else container.allocated),
        "limit": _cores(container.actual.limit if container.actual else None),
    }


def _quota(claimed: Container, quota: int | None) -> int | None:
    """What the container gets if the plan says this. A writer who insists has won, in the kernel as in the API."""
    wanted = claimed.limit or None if quota is None else quota
    return wanted if claimed.left is None else claimed.left


def _is_held(claimed: Container, quota: int | None) -> bool:
    """Whether the API can't have the quota; it does have what another writer insists on."""
    return quota is not None and claimed.left is None and (not claimed.limit or quota < claimed.request)


def _cores(limit: int | None) -> float | None:
    """A limit as the bus carries it; None for none, which 0 means in a pod."""
    return min(limit / 1000, MOST_CORES) if limit else None
