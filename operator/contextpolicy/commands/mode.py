"""`contextpolicy pause`, `resume`, `dry-run` and `promote`: what happens with a policy's plans."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.commands import shadow
from contextpolicy.commands.cluster_access import (
    ClusterAccessError,
    add_namespace,
    api_server,
    policy_object,
    reference_of,
)

if TYPE_CHECKING:
    import argparse

MODES = {
    "pause": ("Paused", "stop planning, and put every container back as it was before the policy"),
    "resume": ("Enforce", "carry plans out (again)"),
    "dry-run": ("DryRun", "plan and tell, but put every container back and change nothing"),
    "promote": ("Enforce", "carry a shadow out in place of the policy that it is a shadow of"),
}


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the commands."""
    for command, (mode, text) in MODES.items():
        parser = subparsers.add_parser(
            command,
            help=text,
            description=f"Set the policy's mode to {mode}: {text}. Under GitOps set spec.mode in Git instead, which "
            "would undo this.",
        )
        parser.add_argument("policy", metavar="POLICY", help="[NAMESPACE/]NAME")
        add_namespace(parser)
        parser.set_defaults(main=main, mode=mode, command=command)


def main(arguments: argparse.Namespace) -> int:
    """Set the mode; setting it to what it is changes nothing."""
    namespace, name = reference_of(arguments.policy, arguments.namespace)
    with api_server() as api:
        body = policy_object(api, namespace, name)
        if arguments.command == "promote":
            shadow.of(body)
        elif arguments.command == "resume" and "shadow" in body["spec"]:
            raise ClusterAccessError(f"{namespace}/{name} is a shadow: `promote` carries it out")
        before = body["spec"].get("mode", "Enforce")
        if before != arguments.mode:
            api.change_policy(namespace, name, {"mode": arguments.mode})
    print(f"{namespace}/{name}: {before} -> {arguments.mode}" if before != arguments.mode else f"{name}: is {before}")
    return 0
