"""How commands reach the cluster: policies through the API server, what only the operator knows by port-forward."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote, urlencode

from contextpolicy.commands.operator_pods import (
    account_of,
    boards_in,
    has_boards,
    namespace_of_board,
    of_release,
    releases,
    running,
)
from contextpolicy.commands.terminal import waiting
from contextpolicy.errors import ActuationError, ContextPolicyError
from contextpolicy.policy.custom_resource import path_of

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.api import ApiServer
    from contextpolicy.cluster.api_connection import Kubeconfig
    from contextpolicy.cluster.serving import Service
    from contextpolicy.commands.operator_pods import OperatorPod

T = TypeVar("T")
OPERATOR = "app.kubernetes.io/part-of=contextpolicy,app.kubernetes.io/component=operator"
PATIENCE = 10.0
"""Seconds that a port-forward may take to open, and an answer to come."""
MEANT = "is {address} the API server of the cluster that you mean (--context, --kubeconfig)?"
REMEDIES = {
    "Unreachable": f"does it run, and {MEANT}",
    "Unreadable": MEANT,
    "NotFound": MEANT,
    "Unauthorized": "log in again, or name a context with valid credentials (--context, --kubeconfig)",
    "Forbidden": "ask for that permission, or name a context that has it (--context, --kubeconfig)",
    "ServerError": "try again; `kubectl get --raw /readyz?verbose` says what is wrong there",
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
    """The cluster or its operator can't be reached, or does not know what is asked for."""


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """Declare which cluster is meant, as kubectl has it."""
    parser.add_argument("--kubeconfig", metavar="FILE", help="default: KUBECONFIG, else ~/.kube/config")
    parser.add_argument("--context", metavar="NAME", dest="cluster", help="of the kubeconfig (default: current)")


def add_namespace(parser: argparse.ArgumentParser, *, or_all: bool = False) -> None:
    """Declare `-n`, perhaps `-A` in its place, and which cluster is meant, as kubectl has it."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "-n", "--namespace", metavar="NS", help="of the policy (default: that of the kubeconfig's context)"
    )
    if or_all:
        where.add_argument("-A", "--all-namespaces", action="store_true", help="all policies of the cluster")
    add_cluster(parser)


def kubeconfig_of(arguments: argparse.Namespace | None) -> Kubeconfig:
    """What the command line says of the cluster."""
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
    """A command ends before anybody could read how often it asked."""

    def on_answer(self, method: str, code: str) -> None:
        """Nothing."""


def reference_of(arguments: argparse.Namespace) -> tuple[str, str]:
    """Namespace and name of what the command line calls a policy: `NAME` with `-n`, or `NAMESPACE/NAME`."""
    before, slash, name = arguments.policy.rpartition("/")
    if slash and arguments.namespace not in (None, before):
        raise ClusterAccessError(f"invalid value {arguments.policy!r}: with -n, expected a name of that namespace")
    return (before if slash else namespace_of(arguments)), name


def namespace_of(arguments: argparse.Namespace | None = None) -> str:
    """The one given, else that of the kubeconfig's context."""
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
        else "the namespace has none: name another with -n"
    )
    raise ClusterAccessError(f"policy {namespace}/{name} not found: {known}")


def policies(api: ApiServer, namespace: str | None) -> list[dict[str, Any]]:
    """Those of a namespace, or of all (None); ClusterAccessError where the cluster does not know what a policy is."""
    try:
        return api.policies(namespace)
    except ActuationError as error:
        if error.reason != "NotFound":
            raise
        meant = MEANT.format(address=api.address)
        raise ClusterAccessError(
            f"ContextPolicy is not defined: install contextpolicy (see `doctor`), or {meant}"
        ) from error


@contextmanager
def operator(
    api: ApiServer, arguments: argparse.Namespace | None = None, namespace: str | None = None
) -> Iterator[Callable[..., Any]]:
    """A function that asks the operator's live page: a path of `live.page_server` and its parameters.

    Of several releases that which serves the `namespace`, if one is given.
    """
    with _leading(_pods(api, namespace), arguments, namespace) as ask:
        yield ask


@contextmanager
def all_boards(
    api: ApiServer, arguments: argparse.Namespace, namespace: str | None
) -> Iterator[Callable[[], list[dict[str, Any]]]]:
    """A function that asks each release for its boards, or the one that serves the `namespace`.

    Of several, each is believed about the namespaces whose Lease names it, and one that does not answer keeps the
    others' boards from nobody: anyone who may create pods can dress one up as an operator.
    """
    pods = _pods(api, namespace)
    with ExitStack() as opened:
        ways = {release: _leading(of_release(pods, release), arguments, namespace) for release in releases(pods)}
        asked = _answers_of({release: partial(opened.enter_context, way) for release, way in ways.items()})
        yield lambda: [
            board
            for release, boards in _answers_of({one: partial(ask, "boards") for one, ask in asked.items()}).items()
            for board in boards_in(boards)
            if len(releases(pods)) == 1 or _holder(api, namespace_of_board(board)) in (None, release)
        ]


def _answers_of(asked: Mapping[str, Callable[[], T]]) -> dict[str, T]:
    """What those that can be asked say, by release; the error of the last one if none can."""
    found: dict[str, T] = {}
    failure: ClusterAccessError | None = None
    for release, ask in asked.items():
        try:
            found[release] = ask()
        except ClusterAccessError as error:
            failure = error
    if failure is not None and not found:
        raise failure
    return found


@contextmanager
def _leading(
    replicas: Sequence[OperatorPod], arguments: argparse.Namespace | None, namespace: str | None
) -> Iterator[Callable[..., Any]]:
    """That of a release's replicas which decides, as far as its boards say."""
    [*others, last] = replicas
    for pod in others:
        with ExitStack() as opened:
            ask = _deciding(opened, pod, arguments, namespace)
            if ask is not None:
                yield ask
                return
    with _forwarded(last, kubeconfig_of(arguments)) as ask:
        yield ask


def _deciding(
    opened: ExitStack, pod: OperatorPod, arguments: argparse.Namespace | None, namespace: str | None
) -> Callable[..., Any] | None:
    """A way to ask the pod; None if it does not answer, or does not decide."""
    try:
        ask = opened.enter_context(_forwarded(pod, kubeconfig_of(arguments)))
        return ask if has_boards(boards_in(ask("boards")), namespace) else None
    except ClusterAccessError:
        return None


@contextmanager
def _forwarded(pod: OperatorPod, kubeconfig: Kubeconfig) -> Iterator[Callable[..., Any]]:
    kubectl = shutil.which("kubectl")
    if kubectl is None:
        raise ClusterAccessError("kubectl is not on the PATH: it opens the way to the operator (or use --connect)")
    named = {"--kubeconfig": kubeconfig.file, "--context": kubeconfig.context}
    options = [f"{option}={value}" for option, value in named.items() if value]
    argv = [kubectl, *options, "port-forward", "--namespace", pod.namespace, f"pod/{pod.name}", f":{pod.port}"]
    forward = subprocess.Popen(argv, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        with waiting("opening a port-forward to the operator"):
            port = _local_port(forward)
        yield asker(port)
    finally:
        forward.terminate()
        forward.communicate()


def _pods(api: ApiServer, namespace: str | None) -> list[OperatorPod]:
    """The operator's pods: one that leads, and its standbys; those of all releases if we may not read the Lease."""
    pods = running(api.items(f"/api/v1/pods?labelSelector={quote(OPERATOR)}"))
    if not pods:
        raise ClusterAccessError(f"no operator runs here, see `doctor`: no running pod has the labels {OPERATOR}")
    holder = _holder(api, namespace) if namespace and len(releases(pods)) > 1 else None
    if holder is None:
        return pods
    chosen = of_release(pods, holder)
    if not chosen:
        known = ", ".join(releases(pods))
        raise ClusterAccessError(f"namespace {namespace} is served by {holder or 'nobody'}: expected one of {known}")
    return chosen


def genuine(api: ApiServer, pods: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those of pods with an operator's labels that can be one's: whose account may list nodes, as none of a tenant may.

    All of them if none may, or if we may not ask; of a single account we need not.
    """
    accounts = sorted({account_of(pod) for pod in pods})
    if len(accounts) < 2:
        return list(pods)
    try:
        able = {user for user in accounts if api.may(user, {"group": "", "resource": "nodes", "verb": "list"})}
    except ActuationError:
        return list(pods)
    return [pod for pod in pods if account_of(pod) in able] or list(pods)


def _holder(api: ApiServer, namespace: str) -> str | None:
    """The release that serves the namespace, by its Lease; None where we may not read that."""
    from contextpolicy.cluster.lease import NAMESPACE_LEASE

    try:
        return api.lease(namespace, NAMESPACE_LEASE).holder
    except ActuationError:
        return None


def _local_port(forward: subprocess.Popen[str]) -> int:
    line = forward.stdout.readline() if forward.stdout else ""
    found = re.search(r"127\.0\.0\.1:(\d+)", line)
    if found is None:
        forward.terminate()
        _, reason = forward.communicate()
        raise ClusterAccessError(f"no port-forward to the operator: {(line + reason).strip()}")
    return int(found[1])


def asker(port: int) -> Callable[..., Any]:
    """A function that asks what listens at this port; ClusterAccessError where that is no answer of an operator."""
    import urllib.error
    import urllib.request
    from http.client import HTTPException

    def ask(path: str, **parameters: object) -> Any:
        try:
            with urllib.request.urlopen(
                f"http://127.0.0.1:{port}/api/{path}?{urlencode(parameters)}", timeout=PATIENCE
            ) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            said = error.read().decode(errors="replace").strip()
            if said == "null":
                return None
            raise ClusterAccessError(f"the operator says: {said}; see `doctor`, or try again") from error
        except (OSError, HTTPException, ValueError) as error:
            said = " ".join(str(error).split())
            raise ClusterAccessError(f"the operator does not answer: {said}; see `doctor`, or try again") from error

    return ask
