"""What stands in the way of deciding on a cluster, found from what its API says, with the remedy. Pure."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.matches import matches
from contextpolicy.cluster.nodes import PROMPT, kubernetes_version
from contextpolicy.cluster.pods import PodView, view
from contextpolicy.cluster.serving import Service
from contextpolicy.errors import PolicyError
from contextpolicy.policy.liveness_probes import probe_warning
from contextpolicy.policy.parsing import parse

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

OLDEST = (1, 33)
"""Kubernetes since which a container can be resized."""

EXPIRES_SOON, EXPIRES_NOW = timedelta(days=30), timedelta(days=7)
"""What is left of a certificate when people should know, and when they have to act: the alerts have the same."""


WERE_TRUE = {False: "were True while an operator served it", None: "were True when last written"}
"""What is said of a policy's conditions by whether an operator serves it, where that is not sure."""


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
    node's kubelet and its metrics as text; `pods` are those of the policies' namespaces; `definition` is the
    CustomResourceDefinition; `deployments` are the operators', read where none has a pod; `services` says by namespace
    whether an operator serves its policies. `ends` says by Secret (namespace/name) when the certificate that a part
    mounts ends, None where it can't be read; `now` is the time.
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
    definition: Mapping[str, Any] | None = None
    deployments: Sequence[Mapping[str, Any]] | None = None
    services: Mapping[str, Service] = field(default_factory=dict)
    ends: Mapping[str, datetime | None] = field(default_factory=dict)
    now: datetime = datetime(1970, 1, 1, tzinfo=UTC)


def checkup(facts: ClusterFacts) -> Iterator[Check]:
    """All checks, from the cluster down to the policies."""
    yield _version("API server", facts.version)
    yield _definition(facts)
    yield from _operator(facts)
    yield _rights(facts)
    yield from _nodes(facts)
    yield _bus(facts)
    yield from _openness(facts.routers or ())
    yield from _certificates(facts)
    yield from _services(facts.services)
    yield from _policies(facts)
    yield from _probes(facts.policies or (), facts.pods)


def _version(subject: str, text: str) -> Check:
    version = kubernetes_version(text)
    if version < OLDEST:
        return Check(
            subject, Verdict.BAD, text, "upgrade to Kubernetes 1.33 or later: older ones cannot resize containers"
        )
    if version < PROMPT:
        remedy = "upgrade to 1.36, or set agent.enabled=true: until then a resize takes 1 to 2 s"
        return Check(subject, Verdict.WARNING, text, remedy)
    return Check(subject, Verdict.OK, text)


def _definition(facts: ClusterFacts) -> Check:
    subject = "ContextPolicy definition"
    if not facts.serves_policies:
        return Check(subject, Verdict.BAD, "not served", "kubectl apply -f crds/, or install the chart")
    if facts.policies is None:
        remedy = "choose a namespace with --namespace, or use an account that may list policies"
        return Check(subject, Verdict.UNKNOWN, "served, but its policies can't be listed", remedy)
    owner = _release_of(facts.definition or {})
    if owner and facts.operators and owner not in map(_release_of_pod, facts.operators):
        seen = f"belongs to release {owner[1]} in {owner[0]}, which runs no operator"
        remedy = "upgrade it with the release that does: helm upgrade --install ... --take-ownership"
        return Check(subject, Verdict.WARNING, seen, remedy)
    return Check(subject, Verdict.OK, f"served, {len(facts.policies)} policies")


def _release_of(definition: Mapping[str, Any]) -> tuple[str, str] | None:
    """The namespace and name of the Helm release that installed it, None if none did."""
    annotations = (definition.get("metadata") or {}).get("annotations") or {}
    name = annotations.get("meta.helm.sh/release-name")
    return (str(annotations.get("meta.helm.sh/release-namespace", "")), str(name)) if name else None


def _release_of_pod(pod: Mapping[str, Any]) -> tuple[str, str]:
    labels = pod["metadata"].get("labels") or {}
    return str(pod["metadata"].get("namespace", "")), str(labels.get("app.kubernetes.io/instance", ""))


def _operator(facts: ClusterFacts) -> Iterator[Check]:
    pods = facts.operators
    if pods is None:
        yield Check("operator", Verdict.UNKNOWN, "its pods can't be listed", "use an account that may list pods")
        return
    if not pods:
        yield _absent(facts.deployments)
    releases = {(pod["metadata"].get("labels") or {}).get("app.kubernetes.io/instance") for pod in pods}
    if len(releases) > 1:
        names = ", ".join(_name(pod) for pod in pods)
        yield Check("operator", Verdict.WARNING, f"{len(releases)} releases: {names}", "namespaces must not overlap")
    for pod in pods:
        yield _running(f"operator {_name(pod)}", pod)


def _absent(deployments: Sequence[Mapping[str, Any]] | None) -> Check:
    """No pod of an operator: what to do depends on whether one is installed."""
    install = "helm install contextpolicy charts/contextpolicy"
    if deployments is None:
        return Check("operator", Verdict.BAD, "no pod", f"if `helm list -A` has no release of it: {install}")
    if not deployments:
        return Check("operator", Verdict.BAD, "not installed", install)
    metadata, wanted = deployments[0]["metadata"], deployments[0]["spec"].get("replicas", 1)
    where = f"-n {metadata['namespace']} deployment/{metadata['name']}"
    seen = f"no pod: Deployment {_name(deployments[0])} wants {wanted} replicas"
    return Check(
        "operator", Verdict.BAD, seen, f"kubectl describe {where}" if wanted else f"kubectl scale {where} --replicas=1"
    )


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


def _rights(facts: ClusterFacts) -> Check:
    lacking = facts.lacking
    if facts.operators == []:
        return Check("operator's rights", Verdict.UNKNOWN, "no operator runs", "start one, and look again")
    if lacking is None:
        return Check("operator's rights", Verdict.UNKNOWN, "can't be checked", "use an account that may review access")
    if lacking:
        return Check("operator's rights", Verdict.BAD, f"may not {', '.join(lacking)}", "set rbac.create=true")
    return Check("operator's rights", Verdict.OK, "complete")


def _nodes(facts: ClusterFacts) -> Iterator[Check]:
    if facts.nodes is None:
        yield Check("nodes", Verdict.UNKNOWN, "can't be listed", "use an account that may list nodes")
    for node in facts.nodes or ():
        name = node["metadata"]["name"]
        yield _version(f"kubelet of {name}", node["status"]["nodeInfo"]["kubeletVersion"])
        if name in facts.kubelets:
            yield from _kubelet(name, *facts.kubelets[name])
        else:
            yield Check(
                f"cgroups of {name}",
                Verdict.UNKNOWN,
                "its kubelet can't be queried",
                "needs permission for nodes/proxy",
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
        remedy = "pods of policies must be Burstable: a static CPU manager can't resize Guaranteed pods"
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


def _openness(routers: Sequence[Mapping[str, Any]]) -> Iterator[Check]:
    """Whether the chart's routers ask who speaks: they do where they have credentials."""
    for pod in routers:
        names = {one["name"] for part in pod["spec"]["containers"] for one in part.get("env") or ()}
        if "ZENOH_CREDENTIALS" not in names:
            seen = "open: anyone who reaches the router can make contexts begin and end"
            yield Check(f"router {_name(pod)}", Verdict.WARNING, seen, "set security.enabled=true")


def _certificates(facts: ClusterFacts) -> Iterator[Check]:
    for secret, end in facts.ends.items():
        subject = f"certificate in {secret}"
        if end is None:
            yield Check(subject, Verdict.UNKNOWN, "can't be read", "use an account that may read Secrets there")
            continue
        left = end - facts.now
        seen = f"ends {end:%Y-%m-%d}, in {left.days} days" if left > timedelta() else f"ended {end:%Y-%m-%d}"
        verdict = Verdict.BAD if left < EXPIRES_NOW else Verdict.WARNING if left < EXPIRES_SOON else Verdict.OK
        remedy = "find out why its renewal Job fails: kubectl get jobs -n NAMESPACE; or renew your own"
        yield Check(subject, verdict, seen, remedy)


def _services(services: Mapping[str, Service]) -> Iterator[Check]:
    for namespace, service in services.items():
        subject, said = f"namespace {namespace}", service.sentence(namespace)
        if service.served is None:
            yield Check(subject, Verdict.UNKNOWN, said, "use an account that may read Leases there")
        elif not service.served:
            remedy = (
                "start an operator whose watchNamespaces has it; until then its policies' conditions are the last one's"
            )
            yield Check(subject, Verdict.BAD, said, remedy)


def _policies(facts: ClusterFacts) -> Iterator[Check]:
    for policy in facts.policies or ():
        name = f"policy {_name(policy)}"
        if not _conditions(policy):
            remedy = "the operator has not seen it: check that watchNamespaces has its namespace"
            yield Check(name, Verdict.BAD, "without status", remedy)
        bad = [one for one in _conditions(policy) if one["status"] == "False" and one["type"] != "Ready"]
        for one in bad:
            verdict = Verdict.BAD if one["type"] in ("Accepted", "Connected", "Applied") else Verdict.WARNING
            # The operator's message ends with what to do about it.
            yield Check(name, verdict, f"{one['type']}: {one['reason']}", one["message"])
        if _conditions(policy) and not bad:
            served = facts.services.get(policy["metadata"]["namespace"], Service(served=True)).served
            tense = WERE_TRUE.get(served, "are True")
            yield Check(
                name,
                Verdict.OK if served else Verdict.UNKNOWN,
                f"all conditions {tense}",
                f"see namespace {policy['metadata']['namespace']}",
            )


def _probes(policies: Iterable[Mapping[str, Any]], pods: Sequence[Mapping[str, Any]] | None) -> Iterator[Check]:
    """Liveness probes that tasks may fail while they are suspended; what can't be read is reported elsewhere."""
    if pods is None:
        yield Check("tasks", Verdict.UNKNOWN, "their pods can't be listed", "use an account that may list pods")
    views = list(filter(None, map(_view, pods or ())))
    for body in policies:
        with suppress(PolicyError):
            policy = parse(body)
            own = [pod for pod in views if pod.namespace == policy.namespace and not pod.ended]
            for task, pod, container in matches(policy, own):
                warning = probe_warning(policy, task, f"{pod.name}/{container.name}")
                if container.probed and warning is not None:
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
