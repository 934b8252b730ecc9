"""How commands reach the cluster: what the command line says of it, and its policies through the API server."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from contextpolicy.errors import ActuationError, ContextPolicyError
from contextpolicy.policy.custom_resource import path_of

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from contextpolicy.cluster.api import ApiServer
    from contextpolicy.cluster.api_connection import Kubeconfig
    from contextpolicy.cluster.serving import Service

MEANT = "check that {address} is the API server that you mean (--context, --kubeconfig)"
REMEDIES = {
    "Unreachable": f"{MEANT}, and that it is running",
    "Unreadable": MEANT,
    "NotFound": MEANT,
    "Unauthorized": "log in again, or name a context with valid credentials (--context, --kubeconfig)",
    "Forbidden": "ask for that permission, or name a context that has it (--context, --kubeconfig)",
    "ServerError": "try again; `kubectl get --raw /readyz?verbose` shows what is wrong there",
}
"""What to do when the API server does not answer, or refuses, by the reason."""


def carried_out(service: Service, namespace: str) -> bool:
    """Whether an operator carries out what is written there, as far as is known; warns if that is not sure."""
    said = service.sentence(namespace)
    if said:
        rest = "" if service.served is None else "; this takes effect when one does, see `doctor`"
        print(f"warning: {said}{rest}", file=sys.stderr)
    return service.served is not False


class ClusterAccessError(ContextPolicyError):
    """The cluster or its operator can't be reached, or does not have what is asked for."""


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """Declare the options that choose the cluster, as in kubectl."""
    parser.add_argument(
        "--kubeconfig", metavar="FILE", help="the kubeconfig (default: KUBECONFIG, else ~/.kube/config)"
    )
    parser.add_argument("--context", metavar="NAME", dest="cluster", help="the kubeconfig's context (default: current)")


def add_namespace(parser: argparse.ArgumentParser, *, or_all: bool = False) -> None:
    """Declare `-n`, `-A` if `or_all`, and the options that choose the cluster, as in kubectl."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "-n", "--namespace", metavar="NS", help="the policy's namespace (default: that of the kubeconfig's context)"
    )
    if or_all:
        where.add_argument("-A", "--all-namespaces", action="store_true", help="policies of every namespace")
    add_cluster(parser)


def kubeconfig_of(arguments: argparse.Namespace | None) -> Kubeconfig:
    """The kubeconfig and context that the command line names."""
    from contextpolicy.cluster.api_connection import Kubeconfig

    return Kubeconfig(getattr(arguments, "kubeconfig", None), getattr(arguments, "cluster", None))


@contextmanager
def api_server(arguments: argparse.Namespace | None = None) -> Iterator[ApiServer]:
    """The cluster that kubectl would use with these arguments; its refusals say what to do."""
    from contextpolicy.cluster.api import ApiServer

    api = ApiServer(_Uncounted(), kubeconfig_of(arguments))
    try:
        yield api
    except ActuationError as error:
        if error.reason not in REMEDIES:
            raise
        raise ClusterAccessError(f"{error}; {REMEDIES[error.reason].format(address=api.address)}") from error
    finally:
        api.close()


class _Uncounted:
    """Counts nothing: a command ends before its metrics could be scraped."""

    def on_answer(self, method: str, code: str) -> None:
        """Nothing."""


def reference_of(arguments: argparse.Namespace) -> tuple[str, str]:
    """Namespace and name of what the command line calls a policy: `NAME` with `-n`, or `NAMESPACE/NAME`."""
    before, slash, name = arguments.policy.rpartition("/")
    if slash and arguments.namespace not in (None, before):
        raise ClusterAccessError(f"invalid value {arguments.policy!r}: expected a policy of -n {arguments.namespace}")
    return (before if slash else namespace_of(arguments)), name


def namespace_of(arguments: argparse.Namespace | None = None) -> str:
    """The namespace given, else that of the kubeconfig's context."""
    from kubernetes import config
    from yaml import YAMLError

    if getattr(arguments, "namespace", None):
        return str(arguments.namespace)  # type: ignore[union-attr]
    chosen = kubeconfig_of(arguments)
    try:
        contexts, current = config.list_kube_config_contexts(chosen.file)  # type: ignore[no-untyped-call]
    except (config.ConfigException, YAMLError, TypeError, OSError):
        return "default"
    named = next((one for one in contexts if one["name"] == chosen.context), current)
    return str((named or {}).get("context", {}).get("namespace") or "default")


def policy_object(api: ApiServer, namespace: str, name: str) -> dict[str, Any]:
    """The ContextPolicy; ClusterAccessError says which there are if it is none of them."""
    from contextpolicy.policy.suggestions import did_you_mean

    path = path_of(quote(namespace), quote(name))
    try:
        return api.read(path, "metadata", "spec")
    except ActuationError as error:
        if error.reason != "NotFound":
            raise
    names = [policy["metadata"]["name"] for policy in policies(api, namespace)]
    known = (
        f"expected one of {', '.join(names)}{did_you_mean(name, names)}"
        if names
        else "the namespace has no policies; choose another with -n"
    )
    raise ClusterAccessError(f"policy {namespace}/{name} not found: {known}")


def policies(api: ApiServer, namespace: str | None) -> list[dict[str, Any]]:
    """Those of a namespace, or of all (None); ClusterAccessError where the custom resource is not defined."""
    try:
        return list(api.policies(namespace))
    except ActuationError as error:
        if error.reason != "NotFound":
            raise
        meant = MEANT.format(address=api.address)
        raise ClusterAccessError(
            f"ContextPolicy is not defined: install contextpolicy (see `doctor`), or {meant}"
        ) from error
