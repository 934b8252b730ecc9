"""`contextpolicy restore` where other releases serve namespaces, or Leases cannot be read or renewed."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from contextpolicy.cluster.lease import Lease
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import FINALIZER
from tests.commands.restoring import (
    FIRST,
    GREEN,
    REFUSED,
    RELEASE,
    SECRETS,
    Server,
    before,
    by_us,
    moved,
    policy,
    reference,
    signed,
    two_namespaces,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


def test_namespace_of_another_release_is_skipped_even_while_it_is_down(restore: Any) -> None:
    server = two_namespaces()
    code, out = restore(server, "--remove-finalizers", "--release=green/contextpolicy")
    assert code == 0
    assert out.splitlines() == [
        "namespace lab: served by blue/contextpolicy, left alone",
        "far/speech/speech: limit 990m -> 500m",
        "ContextPolicy far/robot: finalizer removed",
    ]
    assert server.cluster.limit("slam") == 990
    assert server.cluster.policies["lab/robot"] == before("slam")
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]


@pytest.mark.parametrize("times", [1, 9])
def test_lease_that_can_not_be_renewed_keeps_no_other_namespace_from_being_restored(
    restore: Any, monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    """Anyone who may write Leases in a namespace can make one that the API server takes from nobody else."""
    server = two_namespaces()
    server.leases["lab"] = GREEN
    write_lease, refusals = server.write_lease, [REFUSED] * times

    def refuse(namespace: str, name: str, content: Lease, timeout: float) -> Lease:
        if namespace == "lab" and refusals:
            raise refusals.pop()
        return write_lease(namespace, name, content, timeout)

    monkeypatch.setattr(server, "write_lease", refuse)
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert code == 2
    assert (server.cluster.limit("speech"), server.cluster.limit("slam")) == (500, 990)
    assert {reference(body): body["metadata"]["finalizers"] for body in server.objects} == {
        "lab/robot": [FINALIZER],
        "far/robot": [],
    }
    assert "ContextPolicy lab/robot: NOT released" in out


def test_namespace_taken_by_another_release_keeps_its_finalizers(restore: Any) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    server.leases = {"lab": replace(FIRST, holder="green/contextpolicy")}
    resize = server.resize

    def lose(namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        server.leases = {"lab": FIRST}
        return resize(namespace, name, patch, manager)

    server.resize = lose
    code, out = restore(server, "--remove-finalizers", "--release=green/contextpolicy")
    assert (code, out) == (0, "lab/slam/slam: limit 990m -> 500m\n")
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]


def test_a_release_keeps_its_lease_while_it_restores(restore: Any) -> None:
    """It would run out, and the next release would take containers for its own that are still to be put back."""
    server = Server(moved(), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.leases = {"lab": GREEN}
    assert restore(server, RELEASE)[0] == 0
    assert len(server.renewals) >= 2
    assert server.leases["lab"].renewed > "2026"


def test_lease_that_is_deleted_while_it_is_renewed_is_nobodys(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """As anyone may who may delete Leases there: the Job failed, or took what it had not restored for gone."""
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    server.leases = {"lab": GREEN}

    def write_lease(*_: object) -> Lease:
        server.leases = {}
        raise ActuationError("NotFound", "no such Lease (HTTP 404)", retriable=False)

    monkeypatch.setattr(server, "write_lease", write_lease)
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert server.cluster.limit("slam") == 500


def test_restore_stops_when_another_release_takes_the_namespace(restore: Any) -> None:
    server = Server(moved(), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.leases = {"lab": GREEN}
    resize = server.resize

    def lose(namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        server.leases = {"lab": FIRST}
        return resize(namespace, name, patch, manager)

    server.resize = lose
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert (code, out.splitlines()) == (
        0,
        [
            "namespace lab: served by blue/contextpolicy, left alone",
            "lab/slam/slam: limit 990m -> 500m",
        ],
    )
    assert server.cluster.limit("speech") == 990
    assert server.cluster.policies["lab/robot"].keys() == {"uid-speech"}


def test_finalizers_stay_where_another_release_was_in_the_middle(restore: Any) -> None:
    """It has given the namespace back when finalizers are removed, but a container was left alone."""
    server = Server(moved(), moved("speech"), policies=[policy(originals=before("slam", "speech"))])
    server.leases = {"lab": GREEN}
    resize, policies = server.resize, server.policies

    def lose(namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        server.leases = {"lab": FIRST}
        return resize(namespace, name, patch, manager)

    def get_back(namespace: str | None) -> Iterable[dict[str, Any]]:
        if server.cluster.calls:
            server.leases = {"lab": GREEN}
        return policies(namespace)

    server.resize, server.policies = lose, get_back  # type: ignore[method-assign]
    code, out = restore(server, "--remove-finalizers", RELEASE)
    assert (code, out.splitlines()[-1]) == (
        1,
        "ContextPolicy lab/robot: NOT released: not all of its containers are restored",
    )
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]
    server.resize = resize
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert server.cluster.limit("speech") == 500


def test_key_stays_while_another_release_has_originals_that_it_signed(restore: Any) -> None:
    server = Server(by_us(), policies=[policy(originals=signed(500))])
    server.secrets, server.leases = dict(SECRETS), {"lab": FIRST}
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert (server.cluster.limit("slam"), server.secrets) == (990, SECRETS)


def test_key_goes_although_another_release_serves_a_namespace(restore: Any) -> None:
    server = Server(by_us(), policies=[policy(originals=before("slam"))])
    server.secrets, server.leases = dict(SECRETS), {"lab": FIRST}
    assert restore(server, "--remove-finalizers", RELEASE)[0] == 0
    assert server.secrets == {}


def test_leases_without_a_holder_are_waited_for_at_once_and_not_for_long(
    restore: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anybody may leave one in each of the namespaces, and the Job has four minutes."""
    names = [f"lab-{index}" for index in range(4)]
    server = Server(policies=[policy(namespace=name) for name in names])
    server.leases = {name: Lease(seconds=60, renewed="1", version="8") for name in names}
    waits: list[float] = []
    monkeypatch.setattr("time.sleep", waits.append)
    code, out = restore(server, *(f"--namespace={name}" for name in names), "--remove-finalizers", RELEASE)
    assert (code, out.count("finalizer removed")) == (0, 4)
    assert 25 <= sum(waits) <= 27


def test_lease_that_could_not_be_read_at_first_is_an_error(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody has waited for it."""
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    read, failures = server.lease, [REFUSED, REFUSED]

    def lease(namespace: str, name: str) -> Lease:
        if failures:
            raise failures.pop()
        return read(namespace, name)

    monkeypatch.setattr(server, "lease", lease)
    assert (restore(server, RELEASE)[0], server.cluster.calls) == (2, [])


def test_deleted_lease_may_be_recreated_by_its_holder(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if sum(waits) == 10:
            server.leases["lab"] = FIRST

    monkeypatch.setattr("time.sleep", wait)
    assert restore(server, "--remove-finalizers", RELEASE) == (
        0,
        "namespace lab: served by blue/contextpolicy, left alone\n",
    )
    assert sum(waits) == 10


def test_wait_for_a_deleted_lease_is_bounded(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])
    waits: list[float] = []
    monkeypatch.setattr("time.sleep", waits.append)
    assert restore(server, RELEASE) == (0, "lab/slam/slam: limit 990m -> 500m\n")
    assert 25 <= sum(waits) <= 27


def test_manual_restore_skips_namespaces_of_a_running_operator(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Green is gone, and its Lease with nobody to renew it."""
    server = two_namespaces()
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if sum(waits) == 10:
            server.leases["lab"] = replace(FIRST, renewed="2", version="9")

    monkeypatch.setattr("time.sleep", wait)
    code, out = restore(server, "--output", "json")
    reported = json.loads(out)
    assert (code, reported["leftAlone"]) == (0, [{"namespace": "lab", "servedBy": "blue/contextpolicy"}])
    assert [one["container"] for one in reported["containers"]] == ["far/speech/speech"]
    assert 30 <= sum(waits) <= 32, "for as long as a Lease lasts, once for all namespaces"


def test_unreadable_lease_changes_nothing(restore: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(moved(), policies=[policy(originals=before("slam"))])

    def refuse(*_: str) -> Lease:
        raise REFUSED

    monkeypatch.setattr(server, "lease", refuse)
    code, out = restore(server, "--remove-finalizers")
    assert (code, server.cluster.calls) == (2, [])
    assert out == "ContextPolicy lab/robot: NOT released: Invalid: no (HTTP 422)\n"
    assert server.objects[0]["metadata"]["finalizers"] == [FINALIZER]
