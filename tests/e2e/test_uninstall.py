"""`helm uninstall` leaves the robot as it was: a release of its own, whose operator moves limits and then goes."""

import pytest

from tests.e2e.cluster import CommandError, apply, apply_definition, delete, get, run, until
from tests.e2e.releases import Release


@pytest.fixture(scope="module")
def left():
    """A robot whose limits a policy had moved when its operator was uninstalled.

    Helm does not wait for the operator's end: the harder case. Somebody has deleted another namespace that it served.
    """
    release, gone = Release("leave", 50), "e2e-leave-gone"
    apply_definition()
    apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": gone}})
    release.install(watchNamespaces=f"{{{release.namespace},{gone}}}")
    try:
        with release.robot() as robot:
            pass
        run("kubectl", "delete", "namespace", gone, "--timeout=60s")
        release.uninstall()
        yield robot, release
    finally:
        release.remove()


def test_containers_are_restored(left):
    robot, _ = left
    robot.expect(slam=500, speech=500)
    for name in ("slam", "speech"):
        pod = get("pod", name, robot.namespace)
        assert pod["spec"]["containers"][0]["resources"] == {
            "requests": {"cpu": "10m", "memory": "32Mi"},
            "limits": {"cpu": "500m", "memory": "64Mi"},
        }
        assert pod["status"]["containerStatuses"][0]["restartCount"] == 0


def test_nothing_of_the_release_stays(left):
    robot, release = left
    until("nothing of the release is there", lambda: release.objects() or True)
    assert robot.limits("slam", "speech") == {"slam": 500, "speech": 500}


def test_the_policy_stays_and_can_be_deleted_at_once(left):
    robot, _ = left
    policy = get("ctxp", "robot", robot.namespace)
    assert "deletionTimestamp" not in policy["metadata"]
    assert not policy["status"].get("originals")
    delete("ctxp", "robot", robot.namespace)
    assert run("kubectl", "get", "ctxp", "-n", robot.namespace, "-o", "name") == ""


def test_lease_is_deleted_so_the_next_operator_leads_at_once(left):
    """Helm takes the operator's rights before it ends, so that it can't give the Lease back; nobody waits for it."""
    _, release = left
    until("nobody holds the Lease", lambda: not release.leader() or release.leader())
    release.install()
    assert f"Pod {release.leader()}" in release.objects(), "ready, but it does not lead"
    with release.robot():
        pass


def test_an_uninstall_that_fails_leaves_no_rights_behind():
    """The restoring Job gets no pod. A later cleanup uses rights of its own."""
    release = Release("stuck", 51)
    apply_definition()
    release.install()
    full = {"hard": {"pods": "0"}}
    metadata = {"name": "full", "namespace": release.system}
    apply({"apiVersion": "v1", "kind": "ResourceQuota", "metadata": metadata, "spec": full})
    try:
        with pytest.raises(CommandError, match="restore"):
            release.uninstall(timeout=10)
        until("no rights of the release are there", lambda: release.rights() or True)
    finally:
        release.remove()
