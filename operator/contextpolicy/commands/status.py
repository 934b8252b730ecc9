"""`contextpolicy status`: what a policy decides, whether it is in force, and what to do if it is not."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.serving import Service
from contextpolicy.commands.cluster_access import (
    ClusterAccessError,
    add_namespace,
    api_server,
    namespace_of,
    policies,
    policy_object,
    reference_of,
)
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import columns, waiting
from contextpolicy.explain.text_table import text_table, wrapped

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable, Iterator, Mapping


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "status",
        help="show what policies decide and whether it is in force",
        description="Show each policy's contexts, shares and conditions, with what to do about a condition that is "
        "False. Where no operator serves a namespace, show its policies' last state, marked as such and not Ready.",
    )
    parser.add_argument("policy", metavar="POLICY", nargs="?", help="[NAMESPACE/]NAME (default: all of the namespace)")
    add_namespace(parser, or_all=True)
    add_output(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Read and print."""
    if arguments.policy and arguments.all_namespaces:
        raise ClusterAccessError(f"invalid value {arguments.policy!r}: expected no name with --all-namespaces")
    where = None if arguments.all_namespaces else namespace_of(arguments)
    with api_server(arguments) as api, waiting("asking the API server"):
        found = [policy_object(api, *reference_of(arguments))] if arguments.policy else policies(api, where)
        services = {space: api.service(space) for space in sorted({one["metadata"]["namespace"] for one in found})}
    summaries = [summary(policy, services[policy["metadata"]["namespace"]]) for policy in found]
    if arguments.output == "table":
        nothing = f"no policies in {f'namespace {where}' if where else 'any namespace'}"
        print("\n\n".join("\n".join(lines(one)) for one in summaries) or nothing)
    else:
        print(structured(summaries[0] if arguments.policy else {"items": summaries}, arguments.output))
    return 0 if all(one["ready"] for one in summaries) else 1


def summary(policy: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """The summary of a policy, from its object: its last state, if no operator serves its namespace."""
    spec, status = policy["spec"], policy.get("status") or {}
    conditions = status.get("conditions") or []
    return {
        "policy": f"{policy['metadata']['namespace']}/{policy['metadata']['name']}",
        "mode": spec.get("mode", "Enforce"),
        "served": service.served,
        "secondsUnserved": service.silent,
        "ready": service.served is not False and _is_ready(conditions),
        "contexts": status.get("activeContexts") or [],
        **_forced(spec.get("force") or {}),
        "shadowOf": (spec.get("shadow") or {}).get("of"),
        "difference": (status.get("shadow") or {}).get("difference"),
        "promotedShadow": status.get("promotedShadow"),
        "plan": status.get("plan"),
        "tasks": status.get("tasks") or [],
        "streams": status.get("streams") or [],
        "conditions": conditions,
    }


def _is_ready(conditions: Iterable[Mapping[str, Any]]) -> bool:
    return any(one["type"] == "Ready" and one["status"] == "True" for one in conditions)


def _forced(force: Mapping[str, str]) -> dict[str, str | None]:
    """The forced context, if any: the field stays in the spec after it has expired."""
    lasts = bool(force) and datetime.fromisoformat(force["until"]) > datetime.now(UTC)
    return {"forced": force["context"] if lasts else None, "forcedUntil": force["until"] if lasts else None}


def lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """The summary for people."""
    ready = "Ready" if _is_ready(summary["conditions"]) else "NOT Ready"
    mode = "" if summary["mode"] == "Enforce" else f", {summary['mode']}"
    forced = f" (forced: {summary['forced']} until {summary['forcedUntil']})" if summary["forced"] else ""
    contexts = ", ".join(summary["contexts"]) or "-"
    state = f"{ready}{mode}, context: {contexts}{forced}"
    said = Service(summary["served"], summary["secondsUnserved"]).sentence(summary["policy"].partition("/")[0])
    if summary["served"] is False:
        yield from _line(f"{summary['policy']}: {said}; what follows is its last state", "")
        yield from _line(state)
    else:
        yield from _line(f"{summary['policy']}: {state}", "")
        yield from _line(said) if said else ()
    if summary["shadowOf"]:
        yield from _line(f"shadow of {summary['shadowOf']}, would change: {summary['difference'] or 'nothing now'}")
    if summary["promotedShadow"]:
        yield from _line(f"its promoted shadow {summary['promotedShadow']} is carried out in its place")
    if summary["plan"]:
        plan = summary["plan"]
        yield from _line(f"plan {plan['sequence']} since {plan['time']}: {plan['cause']}")
    yield from text_table(
        ("TASK", "WEIGHT", "SHARE", "PODS", ""),
        [
            (t["name"], f"{t['weight']:g}", t["share"], str(t["pods"]), "suspended" if t.get("suspended") else "")
            for t in summary["tasks"]
        ],
        columns(),
        indent="  ",
    )
    for stream in summary["streams"]:
        if not stream["healthy"] or stream.get("message"):
            yield from _line(f"stream {stream['name']}: {stream.get('message') or 'silent'}")
    for condition in summary["conditions"]:
        if condition["status"] != "True" and condition["type"] != "Ready":
            said = f"{condition['type']} is {condition['status']} ({condition['reason']})"
            yield from _line(f"{said}: {condition['message']}")


def _line(text: str, indent: str = "  ") -> list[str]:
    return wrapped(text, columns(), indent, f"{indent}  ")
