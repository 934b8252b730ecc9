"""`contextpolicy pause`, `resume`, `dry-run` and `promote`: set what happens with a policy's plans."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.commands import shadow
from contextpolicy.commands.cluster_access import (
    ClusterAccessError,
    add_namespace,
    api_server,
    carried_out,
    policy_object,
    reference_of,
)
from contextpolicy.commands.exit_codes import NO, OK

if TYPE_CHECKING:
    import argparse

MODES = {
    "pause": ("Paused", "POLICY", "stop planning, and give every container back the CPU it had before the policy"),
    "resume": ("Enforce", "POLICY", "carry out plans"),
    "dry-run": ("DryRun", "POLICY", "plan and report, but restore every container and change none"),
    "promote": ("Enforce", "SHADOW", "carry out a shadow in place of its policy"),
}


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the commands."""
    for command, (mode, whose, text) in MODES.items():
        parser = subparsers.add_parser(
            command,
            help=text,
            description=f"Set the {whose.lower()}'s mode to {mode}: {text}. Under GitOps set spec.mode in "
            "Git, or the next sync undoes this.",
        )
        parser.add_argument("policy", metavar=whose, help=f"[NAMESPACE/]NAME of the {whose.lower()}")
        add_namespace(parser)
        parser.set_defaults(main=main, mode=mode, command=command)


def main(arguments: argparse.Namespace) -> int:
    """Set the mode; a policy that already has it is not changed."""
    namespace, name = reference_of(arguments)
    with api_server(arguments) as api:
        body = policy_object(api, namespace, name)
        if arguments.command == "promote":
            shadow.of(body)
        elif arguments.command == "resume" and "shadow" in body["spec"]:
            raise ClusterAccessError(f"{namespace}/{name} is a shadow: use `promote` to carry it out")
        service = api.service(namespace)
        before = body["spec"].get("mode", "Enforce")
        if before != arguments.mode:
            api.change_policy(namespace, name, {"mode": arguments.mode})
    done = f"{before} -> {arguments.mode}" if before != arguments.mode else f"already {before}"
    print(f"{namespace}/{name}: {done}")
    return OK if carried_out(service, namespace) else NO
