"""`contextpolicy doctor`: what is wrong on this cluster, and how to fix it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

from contextpolicy.commands.cluster_access import add_cluster, api_server
from contextpolicy.commands.operator_access import OPERATOR, genuine
from contextpolicy.commands.operator_pods import account_of
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import columns, waiting
from contextpolicy.errors import ActuationError
from contextpolicy.explain.text_table import wrapped
from contextpolicy.policy.custom_resource import DEFINITION, GROUP, PLURAL

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.api import ApiServer
    from contextpolicy.cluster.cluster_facts import ClusterFacts
    from contextpolicy.cluster.pods import PodView

T = TypeVar("T")

ROUTER = OPERATOR.replace("=operator", "=router")
RIGHTS = (
    (GROUP, PLURAL, "", ("list", "watch", "patch")),
    (GROUP, PLURAL, "status", ("patch",)),
    ("", "pods", "", ("get", "list", "watch")),
    ("", "pods", "resize", ("patch",)),
    ("", "events", "", ("create",)),
)
"""What the operator must be allowed in the namespaces of policies; nodes are checked apart."""
DEFINITION_PATH = f"/apis/apiextensions.k8s.io/v1/customresourcedefinitions/{DEFINITION}"


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "doctor",
        help="find what is wrong on this cluster",
        description="Check the API server, kubelets, cgroups, the operator and its rights, the bus and every policy, "
        "and say how to fix what is wrong. Changes nothing. What you may not read is unknown, not wrong.",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "-n",
        "--namespace",
        metavar="NS",
        action="append",
        help="only policies of this namespace; may be repeated",
    )
    where.add_argument("-A", "--all-namespaces", action="store_true", help="policies of every namespace (default)")
    add_cluster(parser)
    add_output(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Check and report."""
    from contextpolicy.cluster.checkup import checkup
    from contextpolicy.cluster.cluster_facts import Verdict

    with api_server(arguments) as api, waiting("looking at the cluster"):
        checks = list(checkup(facts(api, arguments.namespace or [None])))
    if arguments.output == "table":
        for check in checks:
            line = f"{check.subject}: {check.seen}"
            print(*wrapped(line, columns(), f"{check.verdict.upper():8} ", " " * 9), sep="\n")
            if check.remedy and check.verdict is not Verdict.OK:
                print(*wrapped(check.remedy, columns(), f"{'':9}-> ", " " * 12), sep="\n")
    else:
        items = [{**asdict(check), "verdict": str(check.verdict)} for check in checks]
        print(structured({"items": items}, arguments.output))
    return 1 if any(check.verdict is Verdict.BAD for check in checks) else 0


def facts(api: ApiServer, namespaces: Sequence[str | None]) -> ClusterFacts:
    """Everything that may be read, of policies in these namespaces (None: all); what may not is None."""
    from contextpolicy.cluster.cluster_facts import ClusterFacts

    version = str(api.read("/version", "gitVersion")["gitVersion"])
    served = api.serves_policies()
    policies = _allowed(lambda: _policies(api, namespaces)) if served else None
    operators = _allowed(lambda: genuine(api, _pods(api, OPERATOR)))
    nodes = _allowed(lambda: api.items("/api/v1/nodes"))
    kubelets = {name: one for node in nodes or () if (one := _kubelet(api, name := node["metadata"]["name"]))}
    lacking = _lacking(api, operators[0], policies or ()) if operators else None
    routers = _allowed(lambda: _beside(operators, _pods(api, ROUTER)))
    definition = _allowed(lambda: api.read(DEFINITION_PATH))
    used = sorted({policy["metadata"]["namespace"] for policy in policies or ()})
    pods = _allowed(lambda: [pod for namespace in used for pod in _views(api, namespace)])
    return ClusterFacts(
        version,
        policies,
        operators,
        routers,
        nodes,
        lacking,
        kubelets,
        serves_policies=served,
        pods=pods,
        deployments=None if operators else _allowed(lambda: _deployments(api)),
        services={namespace: api.service(namespace) for namespace in used},
        definition=definition,
        ends=_ends(api, [*(operators or ()), *(routers or ())]),
        now=datetime.now(UTC),
    )


def _ends(api: ApiServer, pods: Sequence[Mapping[str, Any]]) -> dict[str, datetime | None]:
    """When the certificates end by which these pods say who they are on the bus, by Secret."""
    mounted = {
        (pod["metadata"]["namespace"], volume["secret"]["secretName"])
        for pod in pods
        for volume in pod["spec"].get("volumes") or ()
        if volume["name"] == "bus" and "secret" in volume
    }
    return {f"{space}/{name}": _allowed(partial(_end, api, space, name)) for space, name in sorted(mounted)}


def _end(api: ApiServer, namespace: str, secret: str) -> datetime | None:
    from contextpolicy.bus.expiry import end_of_use

    return end_of_use(api.secret(namespace, secret).files)


def _allowed(read: Callable[[], T]) -> T | None:
    try:
        return read()
    except ActuationError as error:
        if error.reason in ("Forbidden", "NotFound"):
            return None
        raise


def _policies(api: ApiServer, namespaces: Sequence[str | None]) -> list[dict[str, Any]]:
    return [policy for namespace in namespaces for policy in api.policies(namespace)]


def _pods(api: ApiServer, selector: str) -> list[dict[str, Any]]:
    return api.items(f"/api/v1/pods?labelSelector={quote(selector)}")


def _beside(operators: Sequence[Mapping[str, Any]] | None, routers: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The routers of the operators' releases, which have no account to know them by; all where no operator is known."""
    places = {pod["metadata"]["namespace"] for pod in operators or ()}
    return [pod for pod in routers if not places or pod["metadata"]["namespace"] in places]


def _deployments(api: ApiServer) -> list[dict[str, Any]]:
    return api.items(f"/apis/apps/v1/deployments?labelSelector={quote(OPERATOR)}")


def _views(api: ApiServer, namespace: str) -> Iterator[PodView]:
    """The pods of a namespace that can be read; together they may be too large to be kept."""
    from contextpolicy.cluster.pod_parsing import view

    for pod in api.pods(namespace):
        with suppress(ValueError):
            yield view(pod)


def _kubelet(api: ApiServer, node: str) -> tuple[Mapping[str, Any], str] | None:
    path = f"/api/v1/nodes/{quote(node)}/proxy"
    try:
        return api.read(f"{path}/configz", "kubeletconfig")["kubeletconfig"], api.read_text(f"{path}/metrics")
    except ActuationError:
        return None


def _lacking(api: ApiServer, operator: Mapping[str, Any], policies: Sequence[Mapping[str, Any]]) -> list[str] | None:
    """The rights that the operator's account lacks where it serves policies; None if that can't be asked."""
    user = account_of(operator)
    used = sorted({policy["metadata"]["namespace"] for policy in policies})
    namespaces = _watched(operator) or used or [operator["metadata"]["namespace"]]
    wanted = [
        {"namespace": namespace, "group": group, "resource": resource, "subresource": sub, "verb": verb}
        for namespace in namespaces
        for group, resource, sub, verbs in RIGHTS
        for verb in verbs
    ]
    wanted += [{"group": "", "resource": "nodes", "verb": verb} for verb in ("list", "watch")]
    try:
        return [_told(right) for right in wanted if not api.may(user, right)]
    except ActuationError:
        return None


def _watched(operator: Mapping[str, Any]) -> list[str]:
    """The namespaces that the chart gives this pod; none means all. Elsewhere it needs no rights, and has none."""
    values = {one["name"]: one.get("value") for part in operator["spec"]["containers"] for one in part.get("env") or ()}
    return list(filter(None, (values.get("WATCH_NAMESPACES") or "").split(",")))


def _told(right: Mapping[str, str]) -> str:
    resource = "/".join(filter(None, (right["resource"], right.get("subresource"))))
    return f"{right['verb']} {resource}" + (f" in {right['namespace']}" if right.get("namespace") else "")
