"""What stands in the way of deciding on a cluster, found from what its API says, with what mends it. Pure."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.claims import matches
from contextpolicy.cluster.liveness_probes import probe_warning
from contextpolicy.cluster.pods import PodView, view
from contextpolicy.errors import PolicyError
from contextpolicy.policy.parsing import parse

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

OLDEST, PROMPT = (1, 33), (1, 36)
"""Kubernetes since which a container can be resized, and since which that takes tens of milliseconds."""


class Verdict(StrEnum):
    """How a check ended; `unknown` is one that could not be made."""

    OK = "ok"
    WARNING = "warning"
    BAD = "bad"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Check:
    """One finding: about what, what was seen, and what to do about it (empty when nothing)."""

    subject: str
    verdict: Verdict
    seen: str
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class ClusterFacts:
    """Objects as the API has them. None where the caller may not read them: their checks are `unknown`.

    `lacking` are the operator's rights that are missing, as `verb resource`; `kubelets` the configuration of each
    node's kubelet and its metrics as text; `pods` are those of the policies' namespaces.
    """

    version: str
    policies: Sequence[Mapping[str, Any]] | None
    operators: Sequence[Mapping[str, Any]] | None
    routers: Sequence[Mapping[str, Any]] | None
    nodes: Sequence[Mapping[str, Any]] | None
    lacking: Sequence[str] | None
    kubelets: Mapping[str, tuple[Mapping[str, Any], str]] = field(default_factory=dict)
    serves_policies: bool = True
    pods: Sequence[Mapping[str, Any]] | None = ()


def checkup(facts: ClusterFacts) -> Iterator[Check]:
    """All checks, from the cluster down to the policies."""
    yield _version("API server", facts.version)
    yield _definition(facts)
    yield from _operator(facts.operators)
    yield _rights(facts.lacking)
    yield from _nodes(facts)
    yield _bus(facts)
    yield from _policies(facts.policies or ())
    yield from _probes(facts.policies or (), facts.pods)


def _version(subject: str, text: str) -> Check:
    found = re.match(r"v?(\d+)\.(\d+)", text)
    version = (int(found[1]), int(found[2])) if found else (0, 0)
    if version < OLDEST:
        return Check(subject, Verdict.BAD, text, "upgrade to Kubernetes 1.33 or later: older ones resize no container")
    if version < PROMPT:
        remedy = "upgrade to 1.36, or set agent.enabled=true: until then a resize takes 1 to 2 s"
        return Check(subject, Verdict.WARNING, text, remedy)
    return Check(subject, Verdict.OK, text)


def _definition(facts: ClusterFacts) -> Check:
    subject = "ContextPolicy definition"
    if not facts.serves_policies:
        return Check(subject, Verdict.BAD, "not served", "kubectl apply -f crds/, or install the chart")
    if facts.policies is None:
        remedy = "name a namespace where you may: --namespace; or ask somebody who may list policies"
        return Check(subject, Verdict.UNKNOWN, "served, but its policies can't be listed", remedy)
    return Check(subject, Verdict.OK, f"served, {len(facts.policies)} policies")


def _operator(pods: Sequence[Mapping[str, Any]] | None) -> Iterator[Check]:
    if pods is None:
        yield Check("operator", Verdict.UNKNOWN, "its pods can't be listed", "ask somebody who may list pods")
        return
    if not pods:
        yield Check("operator", Verdict.BAD, "no pod", "helm install contextpolicy charts/contextpolicy")
    releases = {(pod["metadata"].get("labels") or {}).get("app.kubernetes.io/instance") for pod in pods}
    if len(releases) > 1:
        names = ", ".join(_name(pod) for pod in pods)
        yield Check("operator", Verdict.WARNING, f"{len(releases)} releases: {names}", "namespaces must not overlap")
    for pod in pods:
        yield _running(f"operator {_name(pod)}", pod)


def _running(subject: str, pod: Mapping[str, Any]) -> Check:
    status = pod.get("status") or {}
    ready = any(one["type"] == "Ready" and one["status"] == "True" for one in status.get("conditions") or ())
    restarts = sum(one.get("restartCount", 0) for one in status.get("containerStatuses") or ())
    if not ready:
        remedy = f"kubectl describe pod -n {pod['metadata']['namespace']} {pod['metadata']['name']}, and its log"
        return Check(subject, Verdict.BAD, f"{status.get('phase', 'unknown')}, not ready", remedy)
    if restarts:
        remedy = f"kubectl logs --previous -n {pod['metadata']['namespace']} {pod['metadata']['name']}"
        return Check(subject, Verdict.WARNING, f"ready, {restarts} restarts", remedy)
    return Check(subject, Verdict.OK, "ready")


def _rights(lacking: Sequence[str] | None) -> Check:
    if lacking is None:
        return Check("operator's rights", Verdict.UNKNOWN, "can't be asked", "ask somebody who may review access")
    if lacking:
        return Check("operator's rights", Verdict.BAD, f"may not {', '.join(lacking)}", "set rbac.create=true")
    return Check("operator's rights", Verdict.OK, "complete")


def _nodes(facts: ClusterFacts) -> Iterator[Check]:
    if facts.nodes is None:
        yield Check("nodes", Verdict.UNKNOWN, "can't be listed", "ask somebody who may list nodes")
    for node in facts.nodes or ():
        name = node["metadata"]["name"]
        yield _version(f"kubelet of {name}", node["status"]["nodeInfo"]["kubeletVersion"])
        if name in facts.kubelets:
            yield from _kubelet(name, *facts.kubelets[name])
        else:
            yield Check(
                f"cgroups of {name}", Verdict.UNKNOWN, "its kubelet can't be asked", "needs the right nodes/proxy"
            )


def _kubelet(name: str, configuration: Mapping[str, Any], metrics: str) -> Iterator[Check]:
    found = re.search(r"^kubelet_cgroup_version (\d)", metrics, re.MULTILINE)
    seen = f"version {found[1] if found else 'unknown'}, driver {configuration.get('cgroupDriver', 'unknown')}"
    if configuration.get("cpuCFSQuota") is False:
        remedy = "remove cpuCFSQuota: false from its configuration: no limit has any effect"
        yield Check(f"cgroups of {name}", Verdict.BAD, f"{seen}, no CPU quota", remedy)
    else:
        yield Check(f"cgroups of {name}", Verdict.OK, seen)
    if configuration.get("cpuManagerPolicy", "none") != "none":
        remedy = "pods of policies must be Burstable: a static CPU manager resizes no Guaranteed pod"
        yield Check(f"CPU manager of {name}", Verdict.WARNING, str(configuration["cpuManagerPolicy"]), remedy)


def _bus(facts: ClusterFacts) -> Check:
    cut_off = [
        condition
        for policy in facts.policies or ()
        for condition in _conditions(policy)
        if condition["status"] == "False" and (condition["type"] == "Connected" or condition["reason"] == "NoRouter")
    ]
    ready = [pod for pod in facts.routers or () if _running("", pod).verdict in (Verdict.OK, Verdict.WARNING)]
    if cut_off:
        remedy = "check the router's pod and zenoh.connect" if not ready else "check security.* and network policies"
        return Check("bus", Verdict.BAD, cut_off[0]["message"] or "the operator has no router", remedy)
    if facts.routers and not ready:
        return Check("bus", Verdict.BAD, "the chart's router is not ready", "kubectl describe its pod")
    return Check("bus", Verdict.OK, f"{len(ready)} routers of the chart" if ready else "a router of your own")


def _policies(policies: Iterable[Mapping[str, Any]]) -> Iterator[Check]:
    for policy in policies:
        name = f"policy {_name(policy)}"
        if not _conditions(policy):
            remedy = "the operator has not seen it: is its namespace among watchNamespaces?"
            yield Check(name, Verdict.BAD, "without status", remedy)
        bad = [one for one in _conditions(policy) if one["status"] == "False" and one["type"] != "Ready"]
        for one in bad:
            verdict = Verdict.BAD if one["type"] in ("Accepted", "Connected", "Applied") else Verdict.WARNING
            # The operator's message ends with what to do about it.
            yield Check(name, verdict, f"{one['type']}: {one['reason']}", one["message"])
        if _conditions(policy) and not bad:
            yield Check(name, Verdict.OK, "all conditions are True")


def _probes(policies: Iterable[Mapping[str, Any]], pods: Sequence[Mapping[str, Any]] | None) -> Iterator[Check]:
    """Liveness probes that tasks may fail while they are suspended; what can't be read is reported elsewhere."""
    if pods is None:
        yield Check("tasks", Verdict.UNKNOWN, "their pods can't be listed", "ask somebody who may list pods")
    views = list(filter(None, map(_view, pods or ())))
    for body in policies:
        with suppress(PolicyError):
            policy = parse(body)
            own = [pod for pod in views if pod.namespace == policy.namespace and not pod.ended]
            for task, pod, container in matches(policy, own):
                warning = probe_warning(policy, task, pod, container)
                if warning is not None:
                    yield Check(f"task {task.name} of policy {policy.reference}", Verdict.WARNING, *warning)


def _view(pod: Mapping[str, Any]) -> PodView | None:
    try:
        return view(pod)
    except ValueError:
        return None


def _conditions(policy: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    return (policy.get("status") or {}).get("conditions") or ()


def _name(body: Mapping[str, Any]) -> str:
    return f"{body['metadata']['namespace']}/{body['metadata']['name']}"
