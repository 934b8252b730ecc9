"""The key that signs originals: made once, the same for all replicas, and no reason to stand still."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from contextpolicy.cluster.api import Secret
from contextpolicy.cluster.originals_key import LENGTH, PATIENCE, find_key, obtain_key, secret_of
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Mapping

GONE = ActuationError("NotFound", "gone (HTTP 404)", retriable=False)
AWAY = ActuationError("Unreachable", "no answer", retriable=True)
CHANGED = ActuationError("Conflict", "changed (HTTP 409)", retriable=True)


class Api:
    """Has one Secret; `faults` are what the next calls end in."""

    def __init__(self, *faults: ActuationError | None, **files: bytes) -> None:
        self.content = Secret(files, "1")
        self.faults = list(faults)
        self.written = 0

    def secret(self, namespace: str, name: str) -> Secret:
        assert (namespace, name) == ("system", "contextpolicy-originals")
        self._fail()
        return self.content

    def write_secret(self, namespace: str, name: str, files: Mapping[str, bytes], version: str) -> None:
        assert (namespace, name) == ("system", "contextpolicy-originals")
        self._fail()
        assert version == self.content.version, "of two replicas one loses"
        self.content, self.written = Secret({**self.content.files, **files}, "2"), self.written + 1

    def _fail(self) -> None:
        fault = self.faults.pop(0) if self.faults else None
        if fault is not None:
            raise fault


def obtain(api: Api, *, waits: list[float] | None = None) -> bytes | None:
    known = [] if waits is None else waits

    def wait(seconds: float) -> bool:
        known.append(seconds)
        return False

    return obtain_key(api, *secret_of("system/contextpolicy"), wait=wait)


def test_key_is_created_once_and_reused():
    api = Api()
    key = obtain(api)
    assert key is not None
    assert len(key) == LENGTH
    assert [obtain(api), find_key(api, *secret_of("system/contextpolicy"))] == [key, key]
    assert api.written == 1


def test_other_entries_of_the_secret_are_kept():
    api = Api(other=b"x")
    obtain(api)
    assert api.content.files["other"] == b"x"


def test_a_second_replica_adopts_the_firsts_key():
    api = Api(None, CHANGED)
    first = Secret({"key": b"a" * LENGTH}, "2")

    def wait(_: float) -> bool:
        api.content = first
        return False

    assert obtain_key(api, *secret_of("system/contextpolicy"), wait=wait) == b"a" * LENGTH
    assert api.written == 0


@pytest.mark.parametrize("damaged", [b"", b"short"])
def test_an_invalid_key_is_replaced(damaged):
    api = Api(key=damaged)
    assert len(obtain(api) or b"") == LENGTH


def test_key_waits_for_an_unreachable_api():
    waits: list[float] = []
    assert obtain(Api(*[AWAY] * 8), waits=waits) is not None
    assert waits == [0.1, 0.2, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0]


def test_key_waits_for_its_secret_to_appear():
    assert obtain(Api(*[GONE] * PATIENCE)) is not None


def test_originals_stay_unsigned_without_the_secret(caplog):
    assert obtain(Api(*[GONE] * (PATIENCE + 1))) is None
    assert "originals are not signed" in caplog.text


def test_waiting_stops_with_the_operator():
    assert obtain_key(Api(AWAY), *secret_of("system/contextpolicy"), wait=lambda _: True) is None
