"""The key by which the operator recognises the originals that it wrote: made once, kept in a Secret of the release."""

from __future__ import annotations

import logging
import secrets
from typing import TYPE_CHECKING, Protocol

from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from contextpolicy.cluster.api import Secret

log = logging.getLogger(__name__)

ENTRY = "key"
"""The name of the key in the Secret."""
LENGTH = 32
"""Bytes of a key."""
PAUSES = (0.1, 0.2, 0.5, 1.0)
"""Seconds between attempts; the last one repeats."""


class SecretApi(Protocol):
    """The calls to the API server that the key needs."""

    def secret(self, namespace: str, name: str) -> Secret:
        """The files of a Secret."""

    def write_secret(self, namespace: str, name: str, files: Mapping[str, bytes], version: str) -> None:
        """Merge files into a Secret; Conflict when it has changed since `version`."""


PATIENCE = 5
"""Attempts after which a refusal counts: just after an installation the API server may not know the Role yet."""


def secret_of(release: str) -> tuple[str, str]:
    """The namespace and name of the Secret of a release `namespace/name`, as the chart calls it."""
    namespace, _, name = release.partition("/")
    return namespace, f"{name}-originals"


def find_key(api: SecretApi, namespace: str, name: str) -> bytes | None:
    """The key, None where it was not made yet; ActuationError when the Secret can't be read."""
    return _key_in(api.secret(namespace, name))


def obtain_key(api: SecretApi, namespace: str, name: str, wait: Callable[[float], bool]) -> bytes | None:
    """The key, made where there is none; None where the Secret is missing or closed to us, or `wait` says to stop.

    `wait` takes seconds, and says whether to stop. Of two replicas that make a key, the second takes that of the first.
    """
    attempt = 0
    while True:
        try:
            found = api.secret(namespace, name)
            key = _key_in(found)
            return key if key is not None else _make(api, namespace, name, found)
        except ActuationError as error:
            if not error.retriable and attempt >= PATIENCE:
                log.warning("Secret %s/%s can't be used, so originals are not signed: %s", namespace, name, error)
                return None
        if wait(PAUSES[min(attempt, len(PAUSES) - 1)]):
            return None
        attempt += 1


def _make(api: SecretApi, namespace: str, name: str, found: Secret) -> bytes:
    key = secrets.token_bytes(LENGTH)
    api.write_secret(namespace, name, {ENTRY: key}, found.version)
    return key


def _key_in(secret: Secret) -> bytes | None:
    key = secret.files.get(ENTRY, b"")
    return key if len(key) >= LENGTH else None
