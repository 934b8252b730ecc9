"""What stands in the way of deciding on a cluster, found from what its API says, with the remedy. Pure."""

from __future__ import annotations

import re
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster import installation_checks, policy_checks
from contextpolicy.cluster.cluster_facts import Check, Verdict, conditions, name_of
from contextpolicy.cluster.nodes import PROMPT, kubernetes_version

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.cluster.cluster_facts import ClusterFacts

OLDEST = (1, 33)
"""Kubernetes since which a container can be resized."""

EXPIRES_SOON, EXPIRES_NOW = timedelta(days=30), timedelta(days=7)
"""What is left of a certificate when people should know, and when they have to act: the alerts have the same."""


def checkup(facts: ClusterFacts) -> Iterator[Check]:
    """All checks, from the cluster down to the policies."""
    yield _version("API server", facts.version)
    yield installation_checks.definition(facts)
    yield from installation_checks.operator(facts)
    yield installation_checks.rights(facts)
    yield from _nodes(facts)
    yield _bus(facts)
    yield from _openness(facts.routers or ())
    yield from _certificates(facts)
    yield from policy_checks.services(facts.services)
    yield from policy_checks.policies(facts)
    yield from policy_checks.probes(facts.policies or (), facts.pods)


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
        for condition in conditions(policy)
        if condition["status"] == "False" and (condition["type"] == "Connected" or condition["reason"] == "NoRouter")
    ]
    up = (Verdict.OK, Verdict.WARNING)
    ready = [pod for pod in facts.routers or () if installation_checks.running("", pod).verdict in up]
    if cut_off:
        remedy = "check the router's pod and zenoh.connect" if not ready else "check security.* and network policies"
        return Check("bus", Verdict.BAD, cut_off[0]["message"] or "the operator is not connected to a router", remedy)
    if facts.routers and not ready:
        return Check("bus", Verdict.BAD, "the chart's router is not ready", "kubectl describe its pod")
    return Check("bus", Verdict.OK, f"{len(ready)} routers of the chart" if ready else "a router of your own")


def _openness(routers: Sequence[Mapping[str, Any]]) -> Iterator[Check]:
    """Whether the chart's routers ask who speaks: they do where they have credentials."""
    for pod in routers:
        names = {one["name"] for part in pod["spec"]["containers"] for one in part.get("env") or ()}
        if "ZENOH_CREDENTIALS" not in names:
            seen = "open: anyone who can reach the router can start and end contexts"
            yield Check(f"router {name_of(pod)}", Verdict.WARNING, seen, "set security.enabled=true")


def _certificates(facts: ClusterFacts) -> Iterator[Check]:
    for secret, end in facts.ends.items():
        subject = f"certificate in {secret}"
        if end is None:
            yield Check(subject, Verdict.UNKNOWN, "can't be read", "use an account that may read Secrets there")
            continue
        left = end - facts.now
        seen = f"expires {end:%Y-%m-%d}, in {left.days} days" if left > timedelta() else f"expired {end:%Y-%m-%d}"
        verdict = Verdict.BAD if left < EXPIRES_NOW else Verdict.WARNING if left < EXPIRES_SOON else Verdict.OK
        remedy = "find out why its renewal Job fails: kubectl get jobs -n NAMESPACE; or renew your own"
        yield Check(subject, verdict, seen, remedy)
