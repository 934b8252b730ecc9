"""What a checkup finds of the installation: the definition of policies, and the operator with its rights. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.cluster_facts import Check, Verdict, name_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.cluster.cluster_facts import ClusterFacts


def definition(facts: ClusterFacts) -> Check:
    """Whether policies can be created, and the release that defines them runs the operator."""
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


def operator(facts: ClusterFacts) -> Iterator[Check]:
    """Each operator's pod."""
    pods = facts.operators
    if pods is None:
        yield Check("operator", Verdict.UNKNOWN, "its pods can't be listed", "use an account that may list pods")
        return
    if not pods:
        yield _absent(facts.deployments)
    releases = {(pod["metadata"].get("labels") or {}).get("app.kubernetes.io/instance") for pod in pods}
    if len(releases) > 1:
        names = ", ".join(name_of(pod) for pod in pods)
        yield Check("operator", Verdict.WARNING, f"{len(releases)} releases: {names}", "namespaces must not overlap")
    for pod in pods:
        yield running(f"operator {name_of(pod)}", pod)


def _absent(deployments: Sequence[Mapping[str, Any]] | None) -> Check:
    """No pod of an operator: what to do depends on whether one is installed."""
    install = "helm install contextpolicy charts/contextpolicy"
    if deployments is None:
        return Check("operator", Verdict.BAD, "no pod", f"if `helm list -A` shows no release: {install}")
    if not deployments:
        return Check("operator", Verdict.BAD, "not installed", install)
    metadata, wanted = deployments[0]["metadata"], deployments[0]["spec"].get("replicas", 1)
    where = f"-n {metadata['namespace']} deployment/{metadata['name']}"
    seen = f"no pod: Deployment {name_of(deployments[0])} wants {wanted} replicas"
    return Check(
        "operator", Verdict.BAD, seen, f"kubectl describe {where}" if wanted else f"kubectl scale {where} --replicas=1"
    )


def running(subject: str, pod: Mapping[str, Any]) -> Check:
    """Whether a pod is ready, and stays so."""
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


def rights(facts: ClusterFacts) -> Check:
    """Whether the operator may do what it has to."""
    lacking = facts.lacking
    if facts.operators == []:
        return Check("operator's rights", Verdict.UNKNOWN, "no operator runs", "start one, then run `doctor` again")
    if lacking is None:
        return Check("operator's rights", Verdict.UNKNOWN, "can't be checked", "use an account that may review access")
    if lacking:
        return Check("operator's rights", Verdict.BAD, f"may not {', '.join(lacking)}", "set rbac.create=true")
    return Check("operator's rights", Verdict.OK, "complete")
