"""Which operator's pods a command asks: of several releases, that which serves the policy's namespace. Pure.

Anyone who may create pods can dress one up as an operator's, or its page as one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence


class OperatorPod(NamedTuple):
    """Where a replica's live page is; `release` is the namespace and name by which it holds Leases."""

    namespace: str
    name: str
    port: int
    release: str


def running(items: Iterable[Mapping[str, Any]]) -> list[OperatorPod]:
    """Those that run; without pods that claim a Lease of another namespace, which no operator's is.

    Nor those whose page's port is not a number.
    """
    pods = [_read(item) for item in items if item["status"].get("phase") == "Running"]
    return [pod for pod in pods if pod is not None and pod.release.partition("/")[0] in ("", pod.namespace)]


def releases(pods: Iterable[OperatorPod]) -> list[str]:
    """Theirs, each once."""
    return sorted({pod.release for pod in pods})


def of_release(pods: Sequence[OperatorPod], release: str) -> list[OperatorPod]:
    """The replicas of one release."""
    return [pod for pod in pods if pod.release == release]


def boards_in(answer: object) -> list[dict[str, Any]]:
    """The boards in a page's answer; anything else is left out."""
    boards = answer if isinstance(answer, list) else []
    return [board for board in boards if isinstance(board, dict) and isinstance(board.get("policy"), str)]


def has_boards(boards: Iterable[Mapping[str, Any]], namespace: str | None) -> bool:
    """Whether an operator with these boards decides at all, or for this namespace: a standby knows of no policy."""
    return any(namespace in (None, namespace_of_board(board)) for board in boards)


def account_of(pod: Mapping[str, Any]) -> str:
    """The user that a pod of the API acts as."""
    account = pod["spec"].get("serviceAccountName", "default")
    return f"system:serviceaccount:{pod['metadata']['namespace']}:{account}"


def namespace_of_board(board: Mapping[str, Any]) -> str:
    """Of the policy that it shows."""
    return str(board["policy"]).partition("/")[0]


def _read(pod: Mapping[str, Any]) -> OperatorPod | None:
    variables = {one["name"]: one.get("value") for one in pod["spec"]["containers"][0].get("env", ())}
    metadata = pod["metadata"]
    port = variables.get("LIVE_PORT") or "8082"
    if not (port.isascii() and port.isdecimal()):
        return None
    return OperatorPod(metadata["namespace"], metadata["name"], int(port), variables.get("LEASE") or "")
