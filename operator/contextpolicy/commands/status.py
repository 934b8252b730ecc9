"""`contextpolicy status`: what a policy decides, whether it is in force, and what to do if it is not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.commands.cluster_access import (
    add_namespace,
    api_server,
    current_namespace,
    policy_object,
    reference_of,
)
from contextpolicy.commands.structured_output import add_output, structured

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Mapping, Sequence


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "status",
        help="show what policies decide and whether it is in force",
        description="Show each policy's contexts, shares and conditions, with what to do about a condition that is "
        "False. Exit codes: 0 all are Ready, 1 one is not, 2 the cluster can't be read.",
    )
    parser.add_argument("policy", metavar="POLICY", nargs="?", help="[NAMESPACE/]NAME (default: all of the namespace)")
    add_namespace(parser)
    parser.add_argument("-A", "--all-namespaces", action="store_true", help="all policies of the cluster")
    add_output(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Read and print."""
    with api_server() as api:
        if arguments.policy:
            policies = [policy_object(api, *reference_of(arguments.policy, arguments.namespace))]
        else:
            where = None if arguments.all_namespaces else arguments.namespace or current_namespace()
            policies = api.policies(where)
    summaries = [summary(policy) for policy in policies]
    if arguments.output == "text":
        print("\n\n".join("\n".join(lines(one)) for one in summaries) or "no policies")
    else:
        print(structured(summaries[0] if arguments.policy else summaries, arguments.output))
    return 0 if all(one["ready"] for one in summaries) else 1


def summary(policy: Mapping[str, Any]) -> dict[str, Any]:
    """What people want to know of a policy, from its object."""
    spec, status = policy["spec"], policy.get("status") or {}
    conditions = status.get("conditions") or []
    return {
        "policy": f"{policy['metadata']['namespace']}/{policy['metadata']['name']}",
        "mode": spec.get("mode", "Enforce"),
        "ready": any(one["type"] == "Ready" and one["status"] == "True" for one in conditions),
        "contexts": status.get("activeContexts") or [],
        "forced": (spec.get("force") or {}).get("context"),
        "shadowOf": (spec.get("shadow") or {}).get("of"),
        "difference": (status.get("shadow") or {}).get("difference"),
        "promotedShadow": status.get("promotedShadow"),
        "plan": status.get("plan"),
        "tasks": status.get("tasks") or [],
        "streams": status.get("streams") or [],
        "conditions": conditions,
    }


def lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """The summary for people."""
    ready = "Ready" if summary["ready"] else "NOT Ready"
    mode = "" if summary["mode"] == "Enforce" else f", {summary['mode']}"
    forced = f" (forced: {summary['forced']})" if summary["forced"] else ""
    yield f"{summary['policy']}: {ready}{mode}, context: {', '.join(summary['contexts']) or '-'}{forced}"
    if summary["shadowOf"]:
        yield f"  shadow of {summary['shadowOf']}, would change: {summary['difference'] or 'nothing now'}"
    if summary["promotedShadow"]:
        yield f"  carried out as its shadow {summary['promotedShadow']} says"
    if summary["plan"]:
        yield f"  plan {summary['plan']['sequence']} since {summary['plan']['time']}: {summary['plan']['cause']}"
    yield from table(
        ("TASK", "WEIGHT", "SHARE", "PODS", ""),
        [
            (t["name"], f"{t['weight']:g}", t["share"], str(t["pods"]), "suspended" if t.get("suspended") else "")
            for t in summary["tasks"]
        ],
    )
    for stream in summary["streams"]:
        if not stream["healthy"] or stream.get("message"):
            yield f"  stream {stream['name']}: {stream.get('message') or 'silent'}"
    for condition in summary["conditions"]:
        if condition["status"] != "True" and condition["type"] != "Ready":
            yield f"  {condition['type']} is {condition['status']} ({condition['reason']}): {condition['message']}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Columns as wide as their content; nothing without rows."""
    if rows:
        widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
        for row in (head, *rows):
            yield "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
