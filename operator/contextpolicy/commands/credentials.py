"""`contextpolicy credentials ROLE DIRECTORY`: what a client outside the cluster needs to join the bus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from contextpolicy.commands.cluster_access import ClusterAccessError, add_cluster, api_server
from contextpolicy.commands.operator_access import OPERATOR, genuine
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping, Sequence

    from contextpolicy.cluster.api import ApiServer

ROLES = ("sensor", "module", "viewer")
OWN = "-bus-operator"
"""How the operator's Secret ends where the chart makes the certificates."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "credentials",
        help="fetch a role's certificate for the bus",
        description="Write ca.crt, tls.crt and tls.key of a role into a directory, for ZENOH_CREDENTIALS and "
        "--credentials of a driver or a person outside the cluster. Requires the right to read the Secret. "
        "Certificates last a year and are renewed 120 days before they expire: run it again in time.",
    )
    parser.add_argument("role", choices=ROLES, help="what the certificate allows")
    parser.add_argument("directory", type=Path, metavar="DIRECTORY", help="created if it does not exist")
    parser.add_argument(
        "-n", "--namespace", metavar="NS", help="the release's namespace (default: where its operator runs)"
    )
    add_cluster(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Fetch and write."""
    with api_server(arguments) as api:
        files = fetch(api, arguments.role, arguments.namespace)
    directory: Path = arguments.directory
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    for name, content in files.items():
        path = directory / name
        path.touch(mode=0o600)
        path.write_bytes(content)
    print(f"{directory}: wrote {', '.join(files)} for role {arguments.role}")
    return 0


def fetch(api: ApiServer, role: str, namespace: str | None) -> Mapping[str, bytes]:
    """The files of the role's Secret; ClusterAccessError when there is none yet."""
    where = f"/api/v1/namespaces/{quote(namespace)}/pods" if namespace else "/api/v1/pods"
    place, name = secret_of(role, genuine(api, api.items(f"{where}?labelSelector={quote(OPERATOR)}")))
    try:
        files = api.secret(place, name).files
    except ActuationError as error:
        raise ClusterAccessError(f"Secret {place}/{name} can't be read: {error}") from error
    if not files:
        raise ClusterAccessError(f"Secret {place}/{name} is empty: the Job that creates certificates has not run yet")
    return files


def secret_of(role: str, operators: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Namespace and name of a role's Secret, by what the operator's pods mount."""
    found = {
        (pod["metadata"]["namespace"], volume["secret"]["secretName"])
        for pod in operators
        for volume in pod["spec"].get("volumes") or ()
        if volume["name"] == "bus"
    }
    if not operators:
        raise ClusterAccessError(f"no operator found: no pod has the labels {OPERATOR}")
    if not found:
        raise ClusterAccessError("the bus is open (security.enabled=false): no certificate is needed")
    if len(found) > 1:
        names = ", ".join(sorted(namespace for namespace, _ in found))
        raise ClusterAccessError(f"several releases run here: choose the namespace of one with -n: {names}")
    [(namespace, name)] = found
    if not name.endswith(OWN):
        raise ClusterAccessError(f"the certificates are your own (Secret {namespace}/{name}): the chart creates none")
    return namespace, f"{name.removesuffix(OWN)}-bus-{role}"
