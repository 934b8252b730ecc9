"""Pods by namespace, as policies look at them."""

from __future__ import annotations

from contextpolicy.cluster.pod_directory import PodDirectory
from contextpolicy.cluster.pod_parsing import view
from tests.cluster.builders import NODE, a_pod


def pod(name, namespace="lab", **parts):
    return view(a_pod(name, namespace=namespace, **parts))


def test_a_pod_is_known_by_its_uid_until_it_is_gone():
    directory, slam = PodDirectory(), pod("slam")
    assert directory.put(slam) is None
    newer = pod("slam", labels={"app": "slam"})
    assert directory.put(newer) is slam
    assert directory.pop("uid-slam") is newer
    assert directory.pop("uid-slam") is None


def test_namespace_lists_its_own_pods_only():
    directory = PodDirectory()
    directory.put(pod("slam"))
    directory.put(pod("arm", namespace="elsewhere"))
    assert [one.name for one in directory.of("lab")] == ["slam"]


def test_namespace_view_follows_later_changes():
    directory = PodDirectory()
    shown = directory.of("lab")
    for _ in range(2):
        assert list(shown) == []
        directory.put(pod("slam"))
        assert [one.name for one in shown] == ["slam"]
        assert list(directory.of("lab")) == list(shown)
        directory.pop("uid-slam")
    assert list(shown) == []


def test_empty_namespaces_leave_no_memory():
    directory = PodDirectory()
    for number in range(3):
        one = pod("slam", namespace=f"robot-{number}")
        directory.put(one)
        assert list(directory.of(f"elsewhere-{number}")) == []
        directory.pop(one.uid)
    assert {name: len(kept) for name, kept in vars(directory).items() if kept} == {}


def test_requests_are_summed_by_node_without_some_namespaces():
    directory = PodDirectory()
    far = a_pod("far", namespace="elsewhere")
    far["spec"]["nodeName"] = "robot-2"
    for one in (pod("slam"), pod("arm", namespace="elsewhere"), view(far)):
        directory.put(one)
        directory.put(one)
    assert directory.requested(but=()) == {NODE: 200, "robot-2": 100}
    assert directory.requested(but={"lab"}) == {NODE: 100, "robot-2": 100}
    directory.pop("uid-arm")
    assert directory.requested(but={"lab"}) == {"robot-2": 100}


def test_only_what_kubelets_have_granted_weighs():
    directory = PodDirectory()
    pending = a_pod("pending", namespace="elsewhere")
    directory.put(view(pending | {"status": {"phase": "Pending"}}))
    directory.put(pod("arm", namespace="elsewhere"))
    assert directory.requested(but=()) == {NODE: 200}
    assert directory.granted(but=()) == {NODE: 100}
    directory.put(view(pending))
    assert directory.granted(but=()) == {NODE: 200}
    assert directory.granted(but={"elsewhere"}) == {}
