"""The connections to the API server: requests over a pool, and its errors as ours.

The client library finds the cluster and manages tokens and connections. Its models and serializers are not used: they
would take a third of the operator's own time on the hot path, and a patched pod matters only for its version.
"""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import urllib3
from kubernetes import client, config
from yaml import YAMLError

from contextpolicy.cluster.writers import FIELD_MANAGER
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Mapping

JSON = "application/json"
POOL = 16
"""Connections kept open for patch workers, reporter and watches: a new one costs a TLS handshake."""
TIMEOUT = urllib3.Timeout(connect=2.0, read=5.0)
"""Seconds to wait for a connection and for an answer."""
HEARTBEAT = urllib3.Timeout(connect=2.0, read=90.0)
"""Seconds that a watch may be silent: the server sends a bookmark every minute (KEP-956)."""
CHUNK = 64 * 2**10
"""Bytes that are read at once of an answer whose length is bounded."""

_REASONS = {
    400: ("BadRequest", False),
    401: ("Unauthorized", True),
    403: ("Forbidden", False),
    404: ("NotFound", False),
    409: ("Conflict", True),
    422: ("Invalid", False),
    429: ("TooManyRequests", True),
}


class Kubeconfig(NamedTuple):
    """A kubeconfig file and a context of it; None where kubectl's default is meant."""

    file: str | None = None
    context: str | None = None


class AnswerListener(Protocol):
    """Receives the API server's answers, on any thread."""

    def on_answer(self, method: str, code: str) -> None:
        """A request of this HTTP method was answered with this status code, `none` if there was no answer."""


class ApiConnection:
    """A pool of connections; safe to use from several threads."""

    def __init__(self, listener: AnswerListener, kubeconfig: Kubeconfig | None = None) -> None:
        """Find the cluster as kubectl does: what is named, else the pod's service account, else KUBECONFIG."""
        self._listener = listener
        _configure(kubeconfig or Kubeconfig())
        settings = client.Configuration.get_default_copy()
        settings.connection_pool_maxsize = POOL
        # Callers retry: by then a newer plan may want something else.
        settings.retries = urllib3.Retry(0)
        self._client = client.ApiClient(settings)
        self.address = settings.host
        self._pool = self._client.rest_client.pool_manager.connection_from_url(settings.host)
        self._prefix = (urllib3.util.parse_url(settings.host).path or "").rstrip("/")

    def close(self) -> None:
        """Close the connections."""
        self._client.rest_client.pool_manager.clear()

    def send(  # noqa: PLR0913 - a request has that many parts
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | None,
        content_type: str,
        timeout: urllib3.Timeout = TIMEOUT,
        *,
        manager: str = FIELD_MANAGER,
    ) -> bytes:
        """The answer to a request; ActuationError where there is none, or a refusal."""
        target = path if method == "GET" else f"{path}?fieldManager={manager}"
        content = None if body is None else json.dumps(body).encode()
        response = self._request(method, target, content, content_type=content_type, timeout=timeout)
        if response.status >= 300:
            raise _refusal(response)
        return response.data

    def send_up_to(self, path: str, most: int | None) -> bytes | None:
        """The answer to a GET; None if it has more bytes than `most`, of which no more was read then."""
        response = self._request("GET", path, None, timeout=TIMEOUT, preload_content=False)
        found = bytearray()
        try:
            with response:
                if response.status >= 300:
                    raise _refusal(response)
                for chunk in response.stream(CHUNK):
                    found += chunk
                    if most is not None and len(found) > most:
                        return None
        except (urllib3.exceptions.HTTPError, OSError) as error:
            raise self._unreachable("GET", path, error) from error
        return bytes(found)

    def dated(self, path: str) -> tuple[bytes, datetime]:
        """The answer to a GET, and when it was given by the server's clock; ours where it does not say."""
        response = self._request("GET", path, None, timeout=TIMEOUT)
        if response.status >= 300:
            raise _refusal(response)
        try:
            return response.data, parsedate_to_datetime(response.headers.get("Date", ""))
        except ValueError:
            return response.data, datetime.now(UTC)

    def stream(self, target: str) -> urllib3.BaseHTTPResponse:
        """GET what goes on, one JSON object per line; the caller closes the response."""
        response = self._request("GET", target, None, timeout=HEARTBEAT, preload_content=False)
        if response.status >= 300:
            raise _refusal(response)
        return response

    def _request(self, method: str, target: str, content: bytes | None, **how: Any) -> urllib3.BaseHTTPResponse:
        headers = {"Accept": JSON, "Content-Type": how.pop("content_type", JSON), "User-Agent": FIELD_MANAGER}
        try:
            self._client.update_params_for_auth(headers, [], ["BearerToken"], target, method, content)
            response = self._pool.urlopen(method, self._prefix + target, body=content, headers=headers, **how)
        except config.ConfigException as error:  # the token could not be renewed
            raise ActuationError("NoToken", str(error), retriable=True) from error
        except (urllib3.exceptions.HTTPError, OSError) as error:
            self._listener.on_answer(method, "none")
            raise self._unreachable(method, target, error) from error
        self._listener.on_answer(method, str(response.status))
        return response

    def _unreachable(self, method: str, target: str, error: Exception) -> ActuationError:
        path = target.partition("?")[0]
        message = f"no answer from the API server at {self.address} to {method} {path}: {_cause(error)}"
        return ActuationError("Unreachable", message, retriable=True, in_doubt=True)


def _cause(error: BaseException) -> str:
    """The reason in the system's words, without the client library's objects around it."""
    reason: object = getattr(error, "reason", None)
    if isinstance(reason, BaseException):
        return _cause(reason)
    if isinstance(error, OSError):
        return error.strerror or str(error)
    deeper = error.__cause__ or error.__context__
    return _cause(deeper) if deeper is not None else str(error)


def _configure(kubeconfig: Kubeconfig) -> None:
    if kubeconfig != Kubeconfig():
        _load(kubeconfig)
        return
    try:
        config.load_incluster_config()  # type: ignore[no-untyped-call]
    except config.ConfigException:
        _load(kubeconfig)


def _load(kubeconfig: Kubeconfig) -> None:
    try:
        config.load_kube_config(kubeconfig.file, kubeconfig.context)  # type: ignore[no-untyped-call]
    except (config.ConfigException, YAMLError, OSError) as error:
        file = kubeconfig.file or os.environ.get("KUBECONFIG") or getattr(error, "filename", None)
        where, remedy = (f"{file}: ", "") if file else ("", "; set KUBECONFIG, or pass --kubeconfig")
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error).rstrip(".")
        message = f"no cluster: {where}{reason}{remedy}"
        raise ActuationError("NoCluster", message, retriable=False) from error


def excerpt(answer: bytes) -> str:
    """The beginning of an answer that is not what it should be, on one line."""
    return " ".join(answer[:200].decode(errors="replace").split())


def _refusal(response: urllib3.BaseHTTPResponse) -> ActuationError:
    status, answer = response.status, response.data
    reason, retriable = _REASONS.get(status, ("ServerError" if status >= 500 else "Refused", status >= 500))
    try:
        message = json.loads(answer).get("message", "")
    except (ValueError, AttributeError, RecursionError):
        message = excerpt(answer)
    text = f"{message or 'no message'} (HTTP {status})"
    pause = response.headers.get("Retry-After", "")  # seconds: the API server writes no dates
    return ActuationError(
        reason,
        text,
        retriable=retriable,
        retry_after=float(pause) if pause.isdecimal() else 0.0,
        in_doubt=status >= 500,  # a gateway may have timed out on what the API server then did
    )
