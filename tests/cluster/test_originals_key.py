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


def test_it_is_made_once_and_found_again():
    api = Api()
    key = obtain(api)
    assert key is not None
    assert len(key) == LENGTH
    assert [obtain(api), find_key(api, *secret_of("system/contextpolicy"))] == [key, key]
    assert api.written == 1


def test_what_else_is_in_the_secret_stays():
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


def test_an_api_that_is_away_is_waited_for():
    waits: list[float] = []
    assert obtain(Api(*[AWAY] * 8), waits=waits) is not None
    assert waits == [0.1, 0.2, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0]


def test_a_role_that_is_not_known_yet_is_waited_for():
    assert obtain(Api(*[GONE] * PATIENCE)) is not None


def test_without_a_secret_the_operator_works_all_the_same(caplog):
    assert obtain(Api(*[GONE] * (PATIENCE + 1))) is None
    assert "originals are not signed" in caplog.text


def test_it_ends_when_the_operator_does():
    assert obtain_key(Api(AWAY), *secret_of("system/contextpolicy"), wait=lambda _: True) is None
