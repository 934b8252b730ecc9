"""What a checkup finds of policies: who serves them, what their conditions say, and probes of their tasks. Pure."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.cluster_facts import Check, Verdict, conditions, name_of
from contextpolicy.cluster.matches import matches
from contextpolicy.cluster.serving import Service
from contextpolicy.errors import PolicyError
from contextpolicy.policy.liveness_probes import probe_warning
from contextpolicy.policy.parsing import parse

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.cluster_facts import ClusterFacts
    from contextpolicy.cluster.pods import PodView

WERE_TRUE = {False: "were True while an operator served it", None: "were True when last written"}
"""What is said of a policy's conditions by whether an operator serves it, where that is not sure."""


def services(found: Mapping[str, Service]) -> Iterator[Check]:
    """The namespaces whose policies no operator serves."""
    for namespace, service in found.items():
        subject, said = f"namespace {namespace}", service.sentence(namespace)
        if service.served is None:
            yield Check(subject, Verdict.UNKNOWN, said, "use an account that may read Leases there")
        elif not service.served:
            remedy = "start an operator whose watchNamespaces includes it; until then conditions stay as last written"
            yield Check(subject, Verdict.BAD, said, remedy)


def policies(facts: ClusterFacts) -> Iterator[Check]:
    """What each policy's conditions say."""
    for policy in facts.policies or ():
        name = f"policy {name_of(policy)}"
        if not conditions(policy):
            remedy = "the operator has not seen it: check that watchNamespaces includes its namespace"
            yield Check(name, Verdict.BAD, "without status", remedy)
        bad = [one for one in conditions(policy) if one["status"] == "False" and one["type"] != "Ready"]
        for one in bad:
            verdict = Verdict.BAD if one["type"] in ("Accepted", "Connected", "Applied") else Verdict.WARNING
            # The operator's message ends with what to do about it.
            yield Check(name, verdict, f"{one['type']}: {one['reason']}", one["message"])
        if conditions(policy) and not bad:
            served = facts.services.get(policy["metadata"]["namespace"], Service(served=True)).served
            tense = WERE_TRUE.get(served, "are True")
            yield Check(
                name,
                Verdict.OK if served else Verdict.UNKNOWN,
                f"all conditions {tense}",
                f"see namespace {policy['metadata']['namespace']}",
            )


def probes(bodies: Iterable[Mapping[str, Any]], pods: Sequence[PodView] | None) -> Iterator[Check]:
    """Liveness probes that tasks may fail while they are suspended; what can't be read is reported elsewhere."""
    if pods is None:
        yield Check("tasks", Verdict.UNKNOWN, "their pods can't be listed", "use an account that may list pods")
    for body in bodies:
        with suppress(PolicyError):
            policy = parse(body)
            own = [pod for pod in pods or () if pod.namespace == policy.namespace and not pod.ended]
            for task, pod, container in matches(policy, own):
                warning = probe_warning(policy, task, f"{pod.name}/{container.name}")
                if container.probed and warning is not None:
                    yield Check(f"task {task.name} of policy {policy.reference}", Verdict.WARNING, *warning)
