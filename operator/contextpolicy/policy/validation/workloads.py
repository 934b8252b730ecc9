"""Pods and their controllers in the files beside policies: what their templates have that a policy may harm. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.errors import Finding
from contextpolicy.policy.liveness_probes import probe_warning

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from contextpolicy.policy.spec import Policy

_TEMPLATES: Mapping[str, tuple[str, ...]] = {
    "Pod": (),
    **dict.fromkeys(("Deployment", "StatefulSet", "DaemonSet", "ReplicaSet", "Job"), ("spec", "template")),
    "CronJob": ("spec", "jobTemplate", "spec", "template"),
}
"""Where the object's pods are described."""


class Workload(NamedTuple):
    """The pods of one object: `name` is the object's, `probed` are the containers that have a livenessProbe."""

    namespace: str
    name: str
    labels: Mapping[str, str]
    probed: frozenset[str]


def workloads(body: object) -> Iterator[Workload]:
    """Those of an object or of a List; what is not as Kubernetes writes it is left out."""
    items = _at(body, "items")
    for one in items if isinstance(items, list) else [body]:
        path = _TEMPLATES.get(str(_at(one, "kind")))
        template = None if path is None else _at(one, *path)
        labels = _at(template, "metadata", "labels")
        if isinstance(labels, dict):
            names = _at(one, "metadata", "namespace"), _at(one, "metadata", "name")
            texts = {key: value for key, value in labels.items() if isinstance(value, str)}
            yield Workload(str(names[0] or "default"), str(names[1]), texts, frozenset(_probed(template)))


def probe_findings(policy: Policy, known: Iterable[Workload]) -> Iterator[Finding]:
    """Liveness probes that the policy's tasks may fail while they are suspended."""
    own = [workload for workload in known if workload.namespace == policy.namespace]
    for index, task in enumerate(policy.tasks):
        for workload in own:
            chosen = task.selector is not None and task.selector.matches(workload.labels)
            if chosen and task.container in workload.probed:
                warning = probe_warning(policy, task, f"{workload.name}/{task.container}")
                if warning is not None:
                    yield Finding(f"spec.tasks[{index}]", task.name, str(warning))


def _probed(template: object) -> Iterator[str]:
    for field in ("containers", "initContainers"):
        containers = _at(template, "spec", field)
        for container in containers if isinstance(containers, list) else ():
            if _at(container, "livenessProbe"):
                yield str(_at(container, "name"))


def _at(body: object, *path: str) -> Any:
    """The value at a path; None where there is none."""
    for name in path:
        body = body.get(name) if isinstance(body, dict) else None
    return body
