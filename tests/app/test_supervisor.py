"""The operator's process against a small API server: what it does before it leads, and in what order it ends."""

from __future__ import annotations

import json
import threading
from unittest.mock import Mock, create_autospec
from urllib.error import HTTPError
from urllib.request import urlopen

import kubernetes.config.kube_config
import pytest

from contextpolicy.actuators.resize.stored_originals import UnsignedOriginals
from contextpolicy.app import kopf_threads, supervisor, watches
from contextpolicy.app.kopf_thread import KopfThread
from contextpolicy.app.probes import serve
from contextpolicy.app.settings import Settings
from contextpolicy.app.supervisor import Supervisor, reach
from contextpolicy.app.wiring import Operator
from contextpolicy.cluster.api import ApiServer
from contextpolicy.cluster.fencing import FencedApi
from contextpolicy.cluster.lease import NAMESPACE_LEASE
from contextpolicy.errors import ActuationError
from tests.ports import free_port
from tests.small_cluster import Recorder, SmallCluster
from tests.waiting import PATIENCE, until

OWN = ("system", "release")


class RestartedError(Exception):
    """Ends the process in place of a new program."""


class Restarts:
    def on_deposed(self):
        raise RestartedError


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    with SmallCluster() as running:
        threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        path = tmp_path / "config"
        path.write_text(json.dumps(running.kubeconfig))
        monkeypatch.setenv("KUBECONFIG", str(path))
        monkeypatch.setattr(kubernetes.config.kube_config, "KUBE_CONFIG_DEFAULT_LOCATION", str(path))
        yield running
        for event in (running.pods_allowed, running.nodes_allowed, running.ended):
            event.set()
        running.shutdown()


@pytest.fixture
def reported():
    return Recorder()


class Replica:
    """A replica on a thread, with a operator that only notes."""

    def __init__(self, reported, port, identity, seconds, namespaces):
        self.reported, self.port = reported, port
        self.stop, self.code, self.deposed = threading.Event(), None, threading.Event()
        own = Settings(lease=OWN, lease_seconds=seconds, identity=identity, namespaces=namespaces)
        self.supervisor = Supervisor(ApiServer(Mock()), own, Restarts(), UnsignedOriginals())
        self._server = serve(port, {"/healthz": self.supervisor.hung, "/readyz": self.supervisor.unready})
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        try:
            self.code = self.supervisor.run(self.stop)
        except RestartedError:
            self.deposed.set()
        finally:
            self.supervisor._api.close()

    def end(self):
        self.stop.set()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()
        self._server.shutdown()
        self._server.server_close()

    def page(self, name):
        try:
            with urlopen(f"http://127.0.0.1:{self.port}/{name}", timeout=PATIENCE) as answer:
                return answer.status, answer.read().decode()
        except HTTPError as error:
            with error:
                return error.code, error.read().decode()


@pytest.fixture
def replica(cluster, monkeypatch):
    """Start a replica; its operator is the fixture's, with a router."""
    monkeypatch.setattr(supervisor, "open_client", lambda *_: None)
    started = []

    def start(reported, identity="one", seconds=60, namespaces=("lab",)):
        reported.operator.has_router = True
        monkeypatch.setattr(supervisor, "Operator", create_autospec(Operator, return_value=reported.operator))
        started.append(Replica(reported, free_port(), identity, seconds, namespaces))
        return started[-1]

    yield start
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    cluster.ended.set()
    for one in started:
        one.end()


def test_policies_wait_until_pods_and_nodes_are_listed(cluster, replica, reported):
    """A policy whose containers are not known yet would seem restored, and be gone."""
    one = replica(reported)
    cluster.pods_allowed.set()
    reported.wait_for("pod_changed", "slam")
    assert not cluster.policies_listed.wait(1), "kopf has received policies before the nodes are known"
    assert one.page("readyz")[0] == 503
    cluster.nodes_allowed.set()
    reported.wait_for("policy_deleted", "robot")
    assert [name for name, *_ in reported.calls] == ["pod_changed", "node_changed", "policy_seen", "policy_deleted"]
    assert not cluster.by_kopf, "kopf is too slow for what changes with every resize"
    assert one.page("readyz") == (200, "ok\n")
    reported.restored.set_result(None)


def test_standby_is_ready_once_it_sees_a_renewal(cluster, replica, reported):
    cluster.put_lease(*OWN, holderIdentity="other", leaseDurationSeconds=60)
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    standby = replica(reported)
    reported.wait_for("node_changed", "robot-1")
    assert not cluster.policies_listed.wait(1)
    assert (cluster.holder("lab", NAMESPACE_LEASE), cluster.written) == (None, [])
    assert not standby.supervisor._leadership.may_act("lab")
    assert standby.page("readyz") == (503, "this replica does not hold the Lease and has seen no other renew it\n")
    cluster.put_lease(*OWN, holderIdentity="other", leaseDurationSeconds=60, renewTime="later")
    until(lambda: standby.page("readyz")[0] == 200)
    assert standby.page("readyz") == standby.page("healthz") == (200, "ok\n")


def test_a_standby_leads_as_soon_as_the_lease_is_given_back(cluster, replica, reported):
    cluster.put_lease(*OWN, holderIdentity="other", leaseDurationSeconds=60)
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    standby = replica(reported)
    reported.wait_for("node_changed", "robot-1")
    cluster.put_lease(*OWN, holderIdentity=None, leaseDurationSeconds=1)
    reported.wait_for("policy_deleted", "robot")
    assert (cluster.holder(*OWN), cluster.holder("lab", NAMESPACE_LEASE)) == ("one", "system/release")
    assert standby.supervisor._leadership.may_act("lab")
    assert not standby.supervisor._leadership.may_act("kitchen")


def test_a_deposed_replica_stops_acting_and_restarts(cluster, replica, reported):
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    one = replica(reported)
    reported.wait_for("policy_deleted", "robot")
    cluster.put_lease(*OWN, holderIdentity="other", leaseDurationSeconds=60)
    assert one.deposed.wait(PATIENCE)
    assert not one.supervisor._leadership.may_act("lab")
    with pytest.raises(ActuationError, match="no valid Lease"):
        FencedApi(one.supervisor._api, one.supervisor._leadership).resize("lab", "slam", {}, "contextpolicy")
    assert cluster.holder(*OWN) == "other"


def test_after_each_interruption_what_is_in_force_is_published_again(cluster, replica, reported):
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    one = replica(reported)
    reported.wait_for("policy_deleted", "robot")
    assert ("resume",) not in reported.calls
    for resumed in (1, 2):
        one.supervisor._leadership._claiming.interruptions += 1
        one.supervisor.on_lease()
        until(lambda: reported.calls.count(("resume",)) == resumed)  # noqa: B023 - called in this turn


def test_a_namespace_that_another_release_serves_is_left_alone(cluster, replica, reported, caplog):
    cluster.put_lease("lab", NAMESPACE_LEASE, holderIdentity="elsewhere/release", leaseDurationSeconds=60)
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    one = replica(reported)
    reported.wait_for("node_changed", "robot-1")
    assert not cluster.policies_listed.wait(1)
    assert not one.supervisor._leadership.may_act("lab")
    assert cluster.written == []
    assert "namespace lab is served by elsewhere/release" in caplog.text


def test_a_namespace_without_its_role_is_reported_and_the_others_are_served(cluster, replica, reported, caplog):
    """As after the namespace was deleted while no operator ran: its policies hold it, and the Role went first."""
    cluster.closed.add("gone")
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    one = replica(reported, namespaces=("gone", "lab"))
    reported.wait_for("policy_deleted", "robot")
    assert one.supervisor._leadership.may_act("lab")
    assert not one.supervisor._leadership.may_act("gone")
    assert "contextpolicy restore --namespace gone --remove-finalizers" in caplog.text
    assert one.page("readyz") == (200, "ok\n")


def test_a_policy_created_and_deleted_repeatedly_does_not_interrupt_kopf(cluster, replica, reported, monkeypatch):
    """Each time kopf was stopped and started for all namespaces, which broke off others' edits and deletions."""
    kopf = []

    class Fake(KopfThread):
        def __init__(self, operator, namespaces, listener):
            super().__init__(operator, namespaces, listener)
            kopf.append(self)

    monkeypatch.setattr(kopf_threads, "KopfThread", Fake)
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    one = replica(reported, namespaces=())
    reported.wait_for("policy_deleted", "robot")
    policies, another = one.supervisor._watches._policies, {"name": "p", "namespace": "hall", "uid": "p"}
    for _ in range(20):
        policies.on_object({"metadata": another})
        until(lambda: "hall" in one.supervisor._kopf.namespaces)
        policies.on_gone("p")
    policies.on_object({"metadata": {**another, "namespace": "dock"}})
    until(lambda: "dock" in one.supervisor._kopf.namespaces)
    assert [set(thread.namespaces) for thread in kopf] == [{"lab"}, {"hall"}, {"dock"}]
    assert not any(thread._stop.is_set() for thread in kopf)
    monkeypatch.setattr(watches, "LINGER", 0.0)
    one.supervisor.on_lists()
    until(lambda: "hall" not in one.supervisor._kopf.namespaces)
    assert [thread._stop.is_set() for thread in kopf] == [False, True, False]
    reported.wait_for("abandon", "hall")


def test_lease_is_released_after_the_operator_has_closed(cluster, replica, reported):
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    one = replica(reported)
    reported.wait_for("policy_deleted", "robot")
    held = []
    reported.operator.close.side_effect = lambda: held.append(cluster.holder(*OWN))
    cluster.ended.set()
    one.stop.set()
    one.end()
    assert (one.code, held, cluster.holder(*OWN)) == (0, ["one"], None)
    assert cluster.holder("lab", NAMESPACE_LEASE) == "system/release", "the release's next replica goes on"


def test_connected_session_is_passed_to_the_operator(cluster, replica, reported, monkeypatch):
    one = replica(reported)
    monkeypatch.setattr(supervisor, "open_client", lambda *_: "session")
    one.supervisor._connect()
    assert ("connected", "session") in reported.calls
    assert cluster.installed


def test_readiness_reports_that_no_router_answers(replica, reported, cluster):
    cluster.pods_allowed.set()
    cluster.nodes_allowed.set()
    one = replica(reported)
    reported.wait_for("policy_deleted", "robot")
    reported.operator.has_router = False
    assert one.page("readyz") == (503, "no Zenoh router answers\n")
    assert one.page("healthz")[0] == 200, "a restart would not bring the router back"


def test_start_waits_for_the_api_server_with_short_pauses(monkeypatch):
    answers = iter([ActuationError("Unreachable", "refused", retriable=True), False, True])

    class Api:
        def __init__(self, _):
            pass

        def serves_policies(self):
            answer = next(answers)
            if isinstance(answer, Exception):
                raise answer
            return answer

    paused = []

    class Stop(threading.Event):
        def wait(self, pause=None):
            paused.append(pause)
            return False

    monkeypatch.setattr(supervisor, "ApiServer", Api)
    assert isinstance(reach(Stop(), Mock()), Api)
    assert sum(paused) < 1
    assert max(supervisor.PAUSES) <= 1, "however long it takes"


def test_without_the_custom_resource_the_operator_waits_and_says_what_to_do(cluster, caplog):
    cluster.installed = False

    class Stop(threading.Event):
        def wait(self, _=None):
            return True

    assert reach(Stop(), Mock()) is None
    assert "kubectl apply -f crds/" in caplog.text
