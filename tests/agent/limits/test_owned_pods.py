"""Pods with a CPU limit of their own (`spec.resources`): only their owner moves it, through the kubelet."""

from __future__ import annotations

import pytest

from tests.agent.builders import CHAT, POLICY, SLAM, Tree
from tests.agent.limits.planned import Planned, write
from tests.agent.test_crash_points import Fuse, Killed, points


def pod_of_one_core(tree, **limits):
    """The kubelet gives a container without a limit that of its pod."""
    groups = [tree.container(identity, uid="uid-p", limit=limit or 1000) for identity, limit in limits.items()]
    tree.set(groups[0].parent, 1000)
    return groups


@pytest.fixture
def slam(tree):
    """Has no limit of its own."""
    [group] = pod_of_one_core(tree, **{SLAM: None})
    return group


def seen(tree, *groups):
    return [tree.limit(group) for group in (*groups, groups[0].parent)]


def test_a_container_without_a_limit_is_left_with_its_pods(tree, limits, slam, journal):
    limits.plan({slam: None}, original=None)
    assert seen(tree, slam) == [1000, 1000]
    assert not journal.exists()


def test_a_container_without_a_limit_is_capped_and_gets_its_pods_again(tree, limits, slam):
    limits.plan({slam: 10}, [slam], original=None)
    assert seen(tree, slam) == [10, 1000]
    limits.plan({slam: None}, original=None)
    assert seen(tree, slam) == [1000, 1000]


@pytest.mark.parametrize("leave_agreed", [False, True])
@pytest.mark.parametrize("killed", [False, True])
def test_the_end_of_a_policy_leaves_the_pods_limit(  # noqa: PLR0913, PLR0917 - fixtures
    tree, limits, live, slam, journal, leave_agreed, killed
):
    limits.plan({slam: 10}, [slam], original=None, owned=[slam.parent])
    (live() if killed else limits).release(POLICY, leave_agreed=leave_agreed)
    assert seen(tree, slam) == [1000, 1000]
    assert journal.read_text() == ""


@pytest.mark.parametrize("new", [500, 2000])
@pytest.mark.parametrize("leave_agreed", [False, True])
def test_a_limit_that_the_owner_has_moved_meanwhile_counts(tree, limits, slam, new, leave_agreed):
    limits.plan({slam: 10}, [slam], original=None, owned=[slam.parent])
    write(tree, limits, slam.parent, new)
    assert seen(tree, slam) == [10, new]
    limits.release(POLICY, leave_agreed=leave_agreed)
    assert seen(tree, slam) == [min(1000, new) if leave_agreed else new, new]


def test_a_container_without_a_limit_follows_its_pod(tree, limits, slam):
    limits.plan({slam: None}, original=None, owned=[slam.parent])
    write(tree, limits, slam.parent, 2000)
    assert seen(tree, slam) == [2000, 2000]


def test_a_share_of_more_than_the_pod_has_is_cut(tree, limits):
    [group] = pod_of_one_core(tree, **{SLAM: 300})
    limits.plan({group: 1500}, original=300, owned=[group.parent])
    assert seen(tree, group) == [1000, 1000]
    limits.release(POLICY)
    assert seen(tree, group) == [300, 1000]


def test_the_limit_that_a_sidecar_has_of_its_pod_does_not_add_to_it(tree, limits):
    group, sidecar = pod_of_one_core(tree, **{SLAM: 300, CHAT: None})
    limits.plan({group: 1000}, original=300, owned=[group.parent])
    assert seen(tree, group, sidecar) == [1000, 1000, 1000]


@pytest.mark.parametrize("killed", [False, True])
def test_limits_that_sum_above_the_pods_stay_so(tree, limits, live, killed):
    group, sidecar = pod_of_one_core(tree, **{SLAM: 700, CHAT: 700})
    limits.plan({group: 10}, original=700, owned=[group.parent])
    write(tree, limits, group, 10)
    (live() if killed else limits).release(POLICY)
    assert seen(tree, group, sidecar) == [700, 700, 1000]


WRITES, LINES = 5, 1
"""What the story below costs, and how many of it are lines of the journal."""


@pytest.mark.parametrize(("point", "moment"), points(WRITES, LINES))
def test_a_kill_at_any_write_leaves_the_pods_limit(tmp_path, monkeypatch, point, moment):
    tree, journal = Tree(tmp_path / "cgroup"), tmp_path / "journal"
    group, sidecar = pod_of_one_core(tree, **{SLAM: None, CHAT: 700})

    def live():
        limits = Planned(tree, journal)
        for limit in (10, None):
            limits.plan({group: limit}, original=None, owned=[group.parent])
        limits.release(POLICY)

    fuse = Fuse(monkeypatch)
    fuse.left, fuse.moment = point, moment
    with pytest.raises(Killed):
        live()
    fuse.left = None
    Planned(tree, journal).release(POLICY)
    assert seen(tree, group, sidecar) == [1000, 700, 1000]
