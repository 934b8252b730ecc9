"""How commands reach the cluster: policies through the API server, what only the operator knows by port-forward."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlencode

from contextpolicy.errors import ActuationError, ContextPolicyError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator

    from contextpolicy.cluster.api import ApiServer

OPERATOR = "app.kubernetes.io/name=contextpolicy,app.kubernetes.io/component=operator"
PATIENCE = 10.0
"""Seconds that a port-forward may take to open, and an answer to come."""


class ClusterAccessError(ContextPolicyError):
    """The cluster or its operator can't be reached, or does not know what is asked for."""


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Declare `-n`, as kubectl has it."""
    parser.add_argument(
        "-n", "--namespace", metavar="NS", help="of the policy (default: that of the kubeconfig's context)"
    )


@contextmanager
def api_server() -> Iterator[ApiServer]:
    """The cluster that kubectl would use."""
    from contextpolicy.cluster.api import ApiServer

    api = ApiServer()
    try:
        yield api
    finally:
        api.close()


def reference_of(policy: str, namespace: str | None) -> tuple[str, str]:
    """Namespace and name of what the command line calls a policy: `NAME` with `-n`, or `NAMESPACE/NAME`."""
    before, slash, name = policy.rpartition("/")
    return (before if slash else namespace or current_namespace()), name


def current_namespace() -> str:
    """That of the kubeconfig's current context."""
    from kubernetes import config

    try:
        _, current = config.list_kube_config_contexts()  # type: ignore[no-untyped-call]
    except (config.ConfigException, TypeError):
        return "default"
    return str((current or {}).get("context", {}).get("namespace") or "default")


def policy_object(api: ApiServer, namespace: str, name: str) -> dict[str, Any]:
    """The ContextPolicy; ClusterAccessError says which there are if it is none of them."""
    from contextpolicy.policy.suggestions import did_you_mean

    path = f"/apis/contextpolicy.dev/v1alpha1/namespaces/{quote(namespace)}/contextpolicies/{quote(name)}"
    try:
        return api.read(path)
    except ActuationError as error:
        if error.reason != "NotFound":
            raise
    names = [policy["metadata"]["name"] for policy in api.policies(namespace)]
    allowed = f"one of {', '.join(names)}{did_you_mean(name, names)}" if names else "there is none in this namespace"
    raise ClusterAccessError(f"policy {namespace}/{name} is not allowed: {allowed}")


@contextmanager
def operator(api: ApiServer) -> Iterator[Callable[..., Any]]:
    """A function that asks the operator's live page: a path of `live.page_server` and its parameters."""
    [*standbys, last] = _pods(api)
    for pod in standbys:
        with _forwarded(*pod) as ask:
            # A standby knows of no policy.
            if ask("boards"):
                yield ask
                return
    with _forwarded(*last) as ask:
        yield ask


@contextmanager
def _forwarded(namespace: str, pod: str, port: int) -> Iterator[Callable[..., Any]]:
    kubectl = shutil.which("kubectl")
    if kubectl is None:
        raise ClusterAccessError("kubectl is not on the PATH: it opens the way to the operator (or use --connect)")
    argv = [kubectl, "port-forward", "--namespace", namespace, f"pod/{pod}", f":{port}"]
    forward = subprocess.Popen(argv, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield _asker(_local_port(forward))
    finally:
        forward.terminate()
        forward.communicate()


def _pods(api: ApiServer) -> list[tuple[str, str, int]]:
    """Namespace, name and live port of the operator's pods: one that leads, and its standbys."""
    pods = api.read(f"/api/v1/pods?labelSelector={quote(OPERATOR)}")["items"]
    ready = [pod for pod in pods if pod["status"].get("phase") == "Running"]
    if not ready:
        raise ClusterAccessError(f"no operator runs here: no running pod has the labels {OPERATOR}")
    return [(pod["metadata"]["namespace"], pod["metadata"]["name"], _live_port(pod)) for pod in ready]


def _live_port(pod: dict[str, Any]) -> int:
    variables = {one["name"]: one.get("value") for one in pod["spec"]["containers"][0].get("env", ())}
    return int(variables.get("LIVE_PORT") or 8082)


def _local_port(forward: subprocess.Popen[str]) -> int:
    line = forward.stdout.readline() if forward.stdout else ""
    found = re.search(r"127\.0\.0\.1:(\d+)", line)
    if found is None:
        forward.terminate()
        _, reason = forward.communicate()
        raise ClusterAccessError(f"no port-forward to the operator: {(line + reason).strip()}")
    return int(found[1])


def _asker(port: int) -> Callable[..., Any]:
    import urllib.error
    import urllib.request

    def ask(path: str, **parameters: object) -> Any:
        try:
            with urllib.request.urlopen(
                f"http://127.0.0.1:{port}/api/{path}?{urlencode(parameters)}", timeout=PATIENCE
            ) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            if error.code == 404:
                return None
            raise ClusterAccessError(f"the operator says: {error.read().decode(errors='replace').strip()}") from error
        except OSError as error:
            raise ClusterAccessError(f"the operator does not answer: {error}") from error

    return ask
