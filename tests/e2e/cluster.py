"""kubectl and helm as functions: bounded in time, errors with what the command said."""

from __future__ import annotations

import base64
import json
import subprocess
import time
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.api import ApiServer
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import path_of
from tests.node import shell

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

REPOSITORY = Path(__file__).resolve().parents[2]
PATIENCE = 60.0 * shell.PATIENCE
"""Seconds in which anything must come true, on a node that has half a CPU to itself too; reaction times are for
benchmarks, not for assertions."""
CHART = REPOSITORY / "charts" / "contextpolicy"
NO_RESIZES = "e2e-no-resizes"
READ = {"pod": lambda namespace, name: f"/api/v1/namespaces/{namespace}/pods/{name}", "ctxp": path_of}
"""Where the API server has them."""


class CommandError(AssertionError):
    """A command failed; the message has all that it said."""


def run(*argv: str, stdin: str | None = None, timeout: float = 120) -> str:
    """Run a command and return what it printed."""
    done = subprocess.run(
        argv, input=stdin, capture_output=True, text=True, timeout=timeout * shell.PATIENCE, check=False
    )
    if done.returncode != 0:
        raise CommandError(f"{' '.join(argv)}\n{done.stdout}{done.stderr}")
    return done.stdout


def apply(*objects: dict[str, Any]) -> None:
    """kubectl apply."""
    run("kubectl", "apply", "-f", "-", stdin=json.dumps({"apiVersion": "v1", "kind": "List", "items": list(objects)}))


def apply_definition() -> None:
    """The custom resource, installed by anyone before."""
    definition = REPOSITORY / "crds" / "contextpolicies.contextpolicy.dev.yaml"
    run("kubectl", "apply", "--server-side", "--force-conflicts", "-f", str(definition))


def helm_command(release: str, namespace: str, values: Mapping[str, str], chart: Path = CHART) -> list[str]:
    """How the chart is installed, or upgraded: it returns when all parts are ready.

    Several releases share the node, which a router's usual request would fill.
    """
    values = {"router.resources.requests.cpu": "100m", **values}
    return [
        *("helm", "upgrade", "--install", release, str(chart), "--namespace", namespace, "--create-namespace"),
        *(part for name, value in values.items() for part in ("--set", f"{name}={value}")),
        *("--take-ownership", "--force-conflicts", "--wait", "--timeout", "120s"),
    ]


class Unheard:
    """Nobody counts what the tests ask."""

    def on_answer(self, method: str, code: str) -> None:
        """Nothing."""


@cache
def api_server() -> ApiServer:
    """Connections that are kept open."""
    return ApiServer(Unheard())


def get(kind: str, name: str, namespace: str) -> dict[str, Any]:
    """One object; pods and policies, which tests look at all the time, without a process for each look."""
    if kind in READ:
        with suppress(ActuationError):  # kubectl says what is wrong, or waits
            return api_server().read(READ[kind](namespace, name))
    found: dict[str, Any] = json.loads(run("kubectl", "get", kind, name, "-n", namespace, "-o", "json"))
    return found


def secret_files(name: str, namespace: str, directory: Path) -> Path:
    """What a pod would see of a Secret; nobody else may read it."""
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    for file, content in get("secret", name, namespace)["data"].items():
        (directory / file).write_bytes(base64.b64decode(content))
    return directory


def delete(kind: str, name: str, namespace: str) -> None:
    """Delete and wait until it is gone; nothing to do when it is not there."""
    run("kubectl", "delete", kind, name, "-n", namespace, "--ignore-not-found", "--timeout=60s")


@contextmanager
def resizes_refused(namespace: str, pod: str) -> Iterator[None]:
    """While this holds the API server refuses to resize pods of the namespace; `pod` is one to try it on."""
    objects = refusal_of_resizes(namespace)
    apply(*objects)
    try:
        until("the API refuses resizes", lambda: NO_RESIZES in _tried_resize(namespace, pod))
        yield
    finally:
        for one in objects:
            delete(one["kind"], NO_RESIZES, namespace)
        until("the API takes resizes again", lambda: _tried_resize(namespace, pod) or True)


def refusal_of_resizes(namespace: str) -> list[dict[str, Any]]:
    """The objects by which the API server refuses to resize pods of the namespace."""
    rule = {"apiGroups": [""], "apiVersions": ["v1"], "operations": ["UPDATE"], "resources": ["pods/resize"]}
    selector = {"matchLabels": {"kubernetes.io/metadata.name": namespace}}
    spec = {
        "failurePolicy": "Fail",
        "matchConstraints": {"resourceRules": [rule], "namespaceSelector": selector},
        "validations": [{"expression": "false", "message": NO_RESIZES}],
    }
    kinds = {
        "ValidatingAdmissionPolicy": spec,
        "ValidatingAdmissionPolicyBinding": {"policyName": NO_RESIZES, "validationActions": ["Deny"]},
    }
    metadata = {"name": NO_RESIZES}
    return [
        {"apiVersion": "admissionregistration.k8s.io/v1", "kind": kind, "metadata": metadata, "spec": spec}
        for kind, spec in kinds.items()
    ]


def _tried_resize(namespace: str, pod: str) -> str:
    """What the API server says against a resize that it is only asked about; empty when nothing."""
    container = get("pod", pod, namespace)["spec"]["containers"][0]["name"]
    patch = {"spec": {"containers": [{"name": container, "resources": {"limits": {"cpu": "123m"}}}]}}
    how = ("--subresource", "resize", "--dry-run=server", "--patch", json.dumps(patch))
    try:
        run("kubectl", "patch", "pod", pod, "-n", namespace, *how)
    except CommandError as error:
        return str(error)
    return ""


def until(what: str, condition: Callable[..., object], patience: float = PATIENCE) -> None:
    """Wait until a condition holds; `what` says what did not come true.

    A condition that looks at what is not there yet, such as a field of a status, does not hold yet. It is called
    without arguments, and may have defaults: the variables of a loop.
    """
    deadline = time.monotonic() + patience
    last: object = None
    while time.monotonic() < deadline:
        try:
            last = condition()
        except LookupError as missing:
            last = missing
        if last is True:
            return
        time.sleep(0.02 * shell.PATIENCE)
    raise AssertionError(f"not within {patience:g} s: {what}; last seen: {last!r}")
