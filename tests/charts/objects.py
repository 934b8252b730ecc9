"""What a release holds under which values."""

from __future__ import annotations

EVERYTHING = (
    "agent.enabled=true",
    "agent.realtime=true",
    "networkPolicy.enabled=true",
    "metrics.podMonitor.enabled=true",
    "metrics.alerts.enabled=true",
    "metrics.dashboard.enabled=true",
    "imagePullSecrets[0].name=secret",
    "commonLabels.robot=one",
    "router.hostPort=7447",
)


def container(workload):
    (only,) = workload["spec"]["template"]["spec"]["containers"]
    return only


def environment(workload):
    return {entry["name"]: entry.get("value") for entry in container(workload)["env"]}


WORKLOADS = {
    "operator": ("Deployment", "contextpolicy"),
    "router": ("Deployment", "contextpolicy-router"),
    "agent": ("DaemonSet", "contextpolicy-agent"),
}
