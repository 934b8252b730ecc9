"""`contextpolicy force`: have a context hold for a while, whatever the sensors say."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from contextpolicy.commands.cluster_access import (
    ClusterAccessError,
    add_namespace,
    api_server,
    carried_out,
    policy_object,
    reference_of,
)
from contextpolicy.commands.exit_codes import NO, OK
from contextpolicy.errors import ContextPolicyError
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from typing import Any

LONGEST = timedelta(days=1)


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "force",
        help="make a context hold for a limited time",
        description="Make a context hold for a limited time, in addition to those that hold because of the sensors. "
        "Under GitOps set spec.force in Git, or the next sync may undo this.",
    )
    parser.add_argument("policy", metavar="POLICY", help="[NAMESPACE/]NAME")
    parser.add_argument("context", metavar="CONTEXT", nargs="?", help="context to force; not needed with --end")
    parser.add_argument(
        "--for",
        dest="lasts",
        type=_duration,
        metavar="DURATION",
        default="10m",
        help="such as 30s or 2h (default: 10m)",
    )
    parser.add_argument("--end", action="store_true", help="stop forcing a context")
    add_namespace(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Set or remove `spec.force`."""
    if bool(arguments.context) is arguments.end:
        raise ClusterAccessError("expected either a CONTEXT or --end")
    namespace, name = reference_of(arguments)
    with api_server(arguments) as api:
        body = policy_object(api, namespace, name)
        service = api.service(namespace)
        if arguments.end:
            api.change_policy(namespace, name, {"force": None})
            done = "no context is forced"
        else:
            _refuse_unknown(body, arguments.context)
            until = (datetime.now(UTC) + arguments.lasts).strftime("%Y-%m-%dT%H:%M:%SZ")
            api.change_policy(namespace, name, {"force": {"context": arguments.context, "until": until}})
            done = f"{arguments.context} {'holds' if service.served else 'is set to hold'} until {until}"
    print(f"{namespace}/{name}: {done}")
    return OK if carried_out(service, namespace) else NO


def _refuse_unknown(body: dict[str, Any], context: str) -> None:
    known = [one["name"] for one in body["spec"].get("contexts") or ()]
    if context not in known:
        allowed = "expected one of " + ", ".join(known) if known else "the policy has none"
        raise ClusterAccessError(f"unknown context {context!r}: {allowed}{did_you_mean(context, known)}")


def _duration(text: str) -> timedelta:
    from contextpolicy.policy.quantities import parse_duration

    try:
        lasts = timedelta(seconds=parse_duration(text))
    except (ValueError, ContextPolicyError):
        lasts = timedelta()
    if not timedelta() < lasts <= LONGEST:
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected a duration such as 30s or 2h, at most 24h")
    return lasts
