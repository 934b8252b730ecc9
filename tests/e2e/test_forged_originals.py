"""What containers had before is the operator's word: somebody empties, forges or deletes it, and nobody is fooled."""

import json

import pytest

from tests.e2e.cluster import CommandError, apply, apply_definition, delete, get, run, until
from tests.e2e.releases import Release
from tests.e2e.robot import pod

FORGED = {"request": "10m", "limit": "50m"}


@pytest.fixture(scope="module")
def release():
    one = Release("forged", 58)
    apply_definition()
    one.install()
    try:
        yield one
    finally:
        one.remove()


@pytest.fixture
def governed(release):
    """A robot whose pods belong to a controller, which says what they had; its policy is deleted at the end."""
    with release.sensors() as robot:
        robot.drive(0.3)
        robot.start("slam", "speech")
        for task in ("slam", "speech"):
            template = pod(task, robot.namespace, ["sleep", "infinity"], None)
            own = {"metadata": {"labels": template["metadata"]["labels"]}, "spec": template["spec"]}
            own["spec"].pop("terminationGracePeriodSeconds")
            spec = {"replicas": 1, "selector": {"matchLabels": {"app": task}}, "template": own}
            metadata = {"name": task, "namespace": robot.namespace}
            apply({"apiVersion": "apps/v1", "kind": "ReplicaSet", "metadata": metadata, "spec": spec})
            until("it has adopted the pod", lambda t=task: has_owner(t, robot.namespace))
        robot.policy()
        robot.expect(slam=990, speech=10)
        yield robot
        delete("ctxp", "robot", robot.namespace)
        run("kubectl", "delete", "rs", "slam", "speech", "-n", robot.namespace)


def has_owner(name, namespace):
    return bool(get("pod", name, namespace)["metadata"]["ownerReferences"])


def patch(robot, *options, **status):
    how = ("--subresource=status", "--type=merge", "-p", json.dumps({"status": status}))
    run("kubectl", "patch", "ctxp", "robot", "-n", robot.namespace, *how, *options)


def forgery(robot):
    uid = get("pod", "slam", robot.namespace)["metadata"]["uid"]
    return {uid: {"containers": {"slam": FORGED}}}


def emptied(robot):
    return dict.fromkeys(robot.status()["originals"])


@pytest.mark.parametrize("change", [forgery, emptied])
def test_originals_changed_by_an_administrator_are_rewritten(governed, change):
    before = governed.status()["originals"]
    patch(governed, originals=change(governed))
    until("the originals are back", lambda: governed.status()["originals"] == before)
    until("it was reported", lambda: bool(governed.reported("OriginalsChanged")))


def test_status_writers_cannot_change_originals(governed):
    namespace, account = governed.namespace, "system:serviceaccount:nobody:tenant"
    rules = [{"apiGroups": ["contextpolicy.dev"], "resources": ["*"], "verbs": ["*"]}]
    metadata = {"name": "tenant", "namespace": namespace}
    role = {"apiVersion": "rbac.authorization.k8s.io/v1", "kind": "Role", "metadata": metadata, "rules": rules}
    reference = {"apiGroup": "rbac.authorization.k8s.io", "kind": "Role", "name": "tenant"}
    subjects = [{"kind": "User", "name": account, "apiGroup": "rbac.authorization.k8s.io"}]
    binding = {"apiVersion": role["apiVersion"], "kind": "RoleBinding", "metadata": metadata}
    apply(role, {**binding, "roleRef": reference, "subjects": subjects})
    before = governed.status()["originals"]
    with pytest.raises(CommandError, match="only the operator may change"):
        patch(governed, f"--as={account}", originals=emptied(governed))
    patch(governed, f"--as={account}", plan=None)
    assert governed.status()["originals"] == before


@pytest.mark.parametrize(("change", "deleted"), [(emptied, False), (forgery, True)])
def test_originals_changed_during_downtime_are_not_trusted(governed, release, change, deleted):
    run("kubectl", "scale", "deployment", release.name, "-n", release.system, "--replicas=0")
    until("it has ended", lambda: f"Pod {release.leader()}" not in release.objects())
    patch(governed, originals=change(governed))
    if deleted:
        run("kubectl", "delete", "ctxp", "robot", "-n", governed.namespace, "--wait=false")
    run("kubectl", "scale", "deployment", release.name, "-n", release.system, "--replicas=1")
    until("it was reported", lambda: bool(governed.reported("OriginalsUnproven")))
    delete("ctxp", "robot", governed.namespace)
    governed.expect(slam=500, speech=500)
