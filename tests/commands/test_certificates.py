"""The chart's Job at an API server that keeps Secrets, and what people fetch from it."""

from __future__ import annotations

import argparse
import stat
from datetime import UTC, datetime, timedelta

import pytest

from contextpolicy.bus.expiry import end
from contextpolicy.bus.issuing import LIFETIME
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
        self._pods = pods

    def secret(self, namespace, name):
        if Place(namespace, name) not in self.secrets:
            raise ActuationError("NotFound", f"no Secret {name}", retriable=False)
        return self.secrets[Place(namespace, name)]

    def write_secret(self, namespace, name, files, version):
        place = Place(namespace, name)
        if self.secrets[place].version != version:
            raise ActuationError("Conflict", "it has changed", retriable=True)
        self.secrets[place] = Secret(files, str(int(version) + 1))
        self.written.append(place)

    def items(self, path):
        assert path.startswith(("/api/v1/pods?", "/api/v1/namespaces/system/pods?"))
        return list(self._pods)


def test_only_due_certificates_are_written(capsys):
    cluster = Cluster()
    certificates.renew(cluster, RELEASE, NOW, NOW)
    assert sorted(cluster.written) == sorted(RELEASE.places())
    certificates.renew(cluster, RELEASE, NOW + timedelta(days=1), NOW)
    assert len(cluster.written) == len(RELEASE.places())
    assert capsys.readouterr().out.endswith("10 of 10 Secrets are good as they are\n")
    certificates.renew(cluster, RELEASE, NOW + LIFETIME, NOW)
    assert cluster.written.count(RELEASE.authority) == 1


def test_one_of_two_concurrent_writers_retries():
    cluster = Cluster()

    class Overtaken(Cluster):
        def __init__(self):
            self.secrets, self.written = cluster.secrets, []

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
    assert capsys.readouterr().out.startswith(f"the clock can't be right, it says {now:%F}: nothing is renewed")
    assert certificates.built() >= NOW


def test_a_clock_that_is_far_ahead_changes_nothing(capsys):
    cluster = Cluster()
    certificates.renew(cluster, RELEASE, NOW, NOW)
    before = dict(cluster.secrets)
    certificates.renew(cluster, RELEASE, datetime(2106, 2, 7, tzinfo=UTC), NOW)
    assert cluster.secrets == before
    assert "the clock can't be right, it says 2106-02-07: nothing is renewed" in capsys.readouterr().out


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
        ((), "no operator is here"),
        ((pod(""),), "the bus is open"),
        ((pod("mine"),), r"your own \(Secret system/mine\)"),
        ((pod(), pod(namespace="lab")), "several releases run here: name the namespace of one with -n: lab, system"),
        ((pod("gone-bus-operator"),), "Secret system/gone-bus-sensor can't be read: no Secret"),
        ((pod(),), "Secret system/ctxp-bus-sensor is empty: the Job"),
    ],
)
def test_missing_credentials_are_explained(pods, said):
    with pytest.raises(ClusterAccessError, match=said):
        credentials.fetch(Cluster(pods=pods), "sensor", None)


def test_replicas_of_a_release_share_one_secret():
    assert credentials.secret_of("viewer", [pod(), pod()]) == ("system", "ctxp-bus-viewer")
