"""The chart's Job at an API server that keeps Secrets, and what people fetch from it."""

from __future__ import annotations

import argparse
import stat
from base64 import b64encode
from datetime import UTC, datetime, timedelta

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from contextpolicy.bus.expiry import end
from contextpolicy.bus.issuing import AUTHORITY_LIFETIME, LIFETIME, found_authority, pem
from contextpolicy.bus.renewal import Place, Release
from contextpolicy.cluster.api import ApiServer, Secret
from contextpolicy.commands import certificates, credentials
from contextpolicy.commands.cluster_access import ClusterAccessError
from contextpolicy.errors import ActuationError

NOW = datetime(2026, 11, 24, tzinfo=UTC)
RELEASE = Release("system", "ctxp", names=["localhost"], shared=["robot"])


class Cluster(ApiServer):
    """Keeps Secrets, and refuses to write one that has changed."""

    def __init__(self, release=RELEASE, pods=()):
        self.secrets = {place: Secret({}, "1") for place in release.places()}
        self.written: list[Place] = []
        self.immutable: set[Place] = set()
        self.genuine = ["system", "canary"]
        """Namespaces whose accounts may list nodes."""
        self._pods = pods

    def secret(self, namespace, name):
        if Place(namespace, name) not in self.secrets:
            raise ActuationError("NotFound", f"no Secret {name}", retriable=False)
        return self.secrets[Place(namespace, name)]

    def write_secret(self, namespace, name, files, version):
        place = Place(namespace, name)
        if place in self.immutable:
            raise ActuationError("Invalid", "field is immutable when `immutable` is set", retriable=False)
        if self.secrets[place].version != version:
            raise ActuationError("Conflict", "it has changed", retriable=True)
        self.secrets[place] = Secret(files, str(int(version) + 1))
        self.written.append(place)

    def may(self, user, _right):
        return user.startswith(tuple(f"system:serviceaccount:{namespace}:" for namespace in self.genuine))

    def items(self, path):
        assert path.startswith(("/api/v1/pods?", "/api/v1/namespaces/system/pods?"))
        return list(self._pods)


def test_only_due_certificates_are_written(capsys):
    cluster = Cluster()
    certificates.renew(cluster, RELEASE, NOW, NOW)
    assert sorted(cluster.written) == sorted(RELEASE.places())
    certificates.renew(cluster, RELEASE, NOW + timedelta(days=1), NOW)
    assert len(cluster.written) == len(RELEASE.places())
    assert capsys.readouterr().out.endswith("10 of 10 Secrets need no change\n")
    certificates.renew(cluster, RELEASE, NOW + LIFETIME, NOW)
    assert cluster.written.count(RELEASE.authority) == 1


def test_one_of_two_concurrent_writers_retries():
    cluster = Cluster()

    class Overtaken(Cluster):
        def __init__(self):
            self.secrets, self.written, self.immutable = cluster.secrets, [], set()

        def secret(self, namespace, name):
            before = super().secret(namespace, name)
            if Place(namespace, name) == RELEASE.places()[-1]:
                certificates.renew(cluster, RELEASE, NOW, NOW)
            return before

    with pytest.raises(ActuationError, match="it has changed"):
        certificates.renew(Overtaken(), RELEASE, NOW, NOW)
    certificates.renew(cluster, RELEASE, NOW, NOW)
    assert sorted(cluster.written) == sorted(RELEASE.places())


@pytest.mark.parametrize("now", [datetime(1970, 1, 1, tzinfo=UTC), NOW - timedelta(days=1)])
def test_unset_clock_issues_no_expired_certificate(now, capsys):
    cluster = Cluster()
    certificates.renew(cluster, RELEASE, now, NOW)
    assert end(cluster.secrets[RELEASE.places()[1]].files["tls.crt"]) == NOW + LIFETIME
    assert capsys.readouterr().out.startswith(f"the clock shows {now:%F}, which must be wrong: nothing is renewed")
    assert certificates.built() >= NOW


def test_a_clock_that_is_far_ahead_changes_nothing(capsys):
    cluster = Cluster()
    certificates.renew(cluster, RELEASE, NOW, NOW)
    before = dict(cluster.secrets)
    certificates.renew(cluster, RELEASE, datetime(2106, 2, 7, tzinfo=UTC), NOW)
    assert cluster.secrets == before
    assert "the clock shows 2106-02-07, which must be wrong: nothing is renewed" in capsys.readouterr().out


ROBOTS = [Place("robot", "ctxp-bus-sensor"), Place("robot", "ctxp-bus-module")]
LATER = NOW + LIFETIME


def an_end(year):
    """A certificate that ends then."""
    return pem([found_authority("any", datetime(year, 1, 1, tzinfo=UTC) - AUTHORITY_LIFETIME).certificate])


def of_unknown_version():
    """As X.509 does not have it."""
    der = found_authority("any", NOW).certificate.public_bytes(Encoding.DER)
    broken = b64encode(der.replace(b"\xa0\x03\x02\x01\x02", b"\xa0\x03\x02\x01\x07", 1)).decode()
    return f"-----BEGIN CERTIFICATE-----\n{broken}\n-----END CERTIFICATE-----\n".encode()


def renewed_beside(change):
    """A cluster of which a year later a robot's namespace has been changed by its people; and whether all are good."""
    cluster = Cluster()
    certificates.renew(cluster, RELEASE, NOW, NOW)
    cluster.written.clear()
    change(cluster)
    return cluster, certificates.renew(cluster, RELEASE, LATER, NOW)


def own_and(*others):
    """All places that end after a year."""
    return sorted({*RELEASE.places()} - {RELEASE.key, RELEASE.authority, *ROBOTS} | {*others})


def test_missing_secret_of_a_robot_keeps_no_other_from_being_renewed(capsys):
    cluster, good = renewed_beside(lambda cluster: cluster.secrets.pop(ROBOTS[0]))
    assert (sorted(cluster.written), good) == (own_and(ROBOTS[1]), False)
    written = capsys.readouterr().err
    assert (
        "robot/ctxp-bus-sensor: NOT written: no Secret ctxp-bus-sensor; if it exists, delete it and upgrade" in written
    )


def test_immutable_secret_of_a_robot_keeps_no_other_from_being_renewed(capsys):
    cluster, good = renewed_beside(lambda cluster: cluster.immutable.add(ROBOTS[0]))
    assert (sorted(cluster.written), good) == (own_and(ROBOTS[1]), False)
    assert "robot/ctxp-bus-sensor: NOT written: field is immutable" in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"garbage", of_unknown_version(), an_end(9000)])
def test_whatever_a_robots_secret_holds_is_replaced(content):
    def fill(cluster):
        held = cluster.secrets[ROBOTS[0]]
        cluster.secrets[ROBOTS[0]] = Secret({**held.files, "tls.crt": content}, held.version)

    cluster, good = renewed_beside(fill)
    assert (sorted(cluster.written), good) == (own_and(*ROBOTS), True)


def test_secret_of_a_robot_does_not_affect_the_time(capsys):
    """It would have an authority made that ends after the year 9999, which is an error."""
    cluster = Cluster()
    cluster.secrets[ROBOTS[0]] = Secret({"tls.crt": an_end(9998)}, "1")
    assert certificates.renew(cluster, RELEASE, NOW - timedelta(days=1), NOW)
    assert f"and {NOW:%F} is used instead" in capsys.readouterr().out


def test_exit_code_says_whether_all_are_good(monkeypatch):
    cluster = Cluster()
    monkeypatch.setattr(certificates, "api_server", lambda _: _Opened(cluster))
    given = argparse.Namespace(
        release="system/ctxp", router_name=["localhost"], share=["robot"], no_bus=False, no_signing=False
    )
    assert certificates.main(given) == 0
    del cluster.secrets[ROBOTS[0]]
    assert certificates.main(given) == 1


def pod(mounted="ctxp-bus-operator", namespace="system"):
    volumes = [{"name": "bus", "secret": {"secretName": mounted}}] if mounted else []
    return {"metadata": {"name": "operator", "namespace": namespace}, "spec": {"volumes": volumes}}


def test_a_sensor_gets_its_certificate(tmp_path, monkeypatch):
    cluster = Cluster(pods=[pod()])
    certificates.renew(cluster, RELEASE, NOW, NOW)
    monkeypatch.setattr(cluster, "close", lambda: None, raising=False)
    monkeypatch.setattr(credentials, "api_server", lambda _: _Opened(cluster))
    where = tmp_path / "sensor"
    assert credentials.main(argparse.Namespace(role="sensor", directory=where, namespace=None)) == 0
    assert {path.name: path.read_bytes() for path in where.iterdir()} == cluster.secret(
        "system", "ctxp-bus-sensor"
    ).files
    assert {stat.S_IMODE(path.stat().st_mode) for path in where.iterdir()} == {0o600}
    assert stat.S_IMODE(where.stat().st_mode) == 0o700


class _Opened:
    def __init__(self, api):
        self._api = api

    def __enter__(self):
        return self._api

    def __exit__(self, *_):
        pass


@pytest.mark.parametrize(
    ("pods", "said"),
    [
        ((), "no operator found"),
        ((pod(""),), "the bus is open"),
        ((pod("mine"),), r"your own \(Secret system/mine\)"),
        ((pod(), pod(namespace="canary")), "choose the namespace of one with -n: canary, system$"),
        ((pod("gone-bus-operator"),), "Secret system/gone-bus-sensor can't be read: no Secret"),
        ((pod(),), "Secret system/ctxp-bus-sensor is empty: the Job"),
    ],
)
def test_missing_credentials_are_explained(pods, said):
    with pytest.raises(ClusterAccessError, match=said):
        credentials.fetch(Cluster(pods=pods), "sensor", None)


def test_credentials_are_those_of_the_release_and_not_of_a_tenants_pod_with_its_labels():
    cluster = Cluster(pods=(pod(namespace="lab"), pod()))
    certificates.renew(cluster, RELEASE, NOW, NOW)
    found = credentials.fetch(cluster, "sensor", None)
    assert found == cluster.secret("system", "ctxp-bus-sensor").files


def test_replicas_of_a_release_share_one_secret():
    assert credentials.secret_of("viewer", [pod(), pod()]) == ("system", "ctxp-bus-viewer")
