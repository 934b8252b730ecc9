"""How commands reach the operator: by a port-forward to its live page."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote, urlencode

from contextpolicy.commands.cluster_access import ClusterAccessError, kubeconfig_of
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
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.api import ApiServer
    from contextpolicy.cluster.api_connection import Kubeconfig
    from contextpolicy.commands.operator_pods import OperatorPod

T = TypeVar("T")
OPERATOR = "app.kubernetes.io/part-of=contextpolicy,app.kubernetes.io/component=operator"
PATIENCE = 10.0
"""Seconds that a port-forward may take to open, and an answer to come."""


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
    """The answers by release; the last error if there is none."""
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
        raise ClusterAccessError("kubectl is not on the PATH: it is needed to reach the operator (or use --connect)")
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
        raise ClusterAccessError(f"no operator found, see `doctor`: no running pod has the labels {OPERATOR}")
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

    from contextpolicy.explain.text_table import printable

    def ask(path: str, **parameters: object) -> Any:
        try:
            with urllib.request.urlopen(
                f"http://127.0.0.1:{port}/api/{path}?{urlencode(parameters)}", timeout=PATIENCE
            ) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            said = printable(error.read().decode(errors="replace")).strip()
            if said == "null":
                return None
            raise ClusterAccessError(
                f"the operator answered with an error: {said}; see `doctor`, or try again"
            ) from error
        except (OSError, HTTPException, ValueError, RecursionError) as error:
            said = " ".join(str(error).split())
            raise ClusterAccessError(f"the operator does not answer: {said}; see `doctor`, or try again") from error

    return ask
