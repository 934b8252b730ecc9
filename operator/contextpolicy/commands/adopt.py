"""`contextpolicy adopt`: a promoted shadow has proved itself, and becomes the policy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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
    from collections.abc import Mapping

OF_THE_POLICY = ("mode", "force")
"""Fields that people set on the policy itself, whatever its shadow says."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "adopt",
        help="replace a policy's spec with that of its promoted shadow",
        description="Write the spec of a promoted shadow into the policy that it is a shadow of, and delete the "
        "shadow; nothing that is in force changes. Under GitOps move the spec in Git, or the next sync undoes this.",
    )
    parser.add_argument("policy", metavar="SHADOW", help="[NAMESPACE/]NAME of the shadow")
    add_namespace(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Write, then delete: it can be repeated after a stop in between."""
    namespace, name = reference_of(arguments)
    with api_server(arguments) as api:
        body = policy_object(api, namespace, name)
        of = policy_object(api, namespace, shadow.of(body))
        target = of["metadata"]["name"]
        if (of.get("status") or {}).get("promotedShadow") != name:
            raise ClusterAccessError(
                f"{namespace}/{name} is not in force: `promote` it first, and watch it for a while"
            )
        api.change_policy(namespace, target, adopted(of["spec"], body["spec"]))
        api.delete_policy(namespace, name)
    print(f"{namespace}/{target}: spec replaced by that of {name}, which is deleted")
    return 0


def adopted(spec: Mapping[str, Any], of_shadow: Mapping[str, Any]) -> dict[str, Any]:
    """What to merge into the spec, so that it is the shadow's; None removes a field."""
    taken = {field: value for field, value in of_shadow.items() if field not in ("shadow", *OF_THE_POLICY)}
    return {field: None for field in spec if field not in (*taken, *OF_THE_POLICY)} | taken
