"""A pod's own limit: it grows with its containers, and is the kubelet's otherwise."""

from __future__ import annotations

import shutil

from tests.agent.builders import CHAT, POLICY
from tests.agent.limits.planned import write


def test_a_pod_grows_with_its_container_and_is_left_to_the_kubelet_otherwise(tree, limits, slam, speech):
    limits.plan({slam: 990, speech: 10})
    assert (tree.limit(slam.parent), tree.limit(speech.parent)) == (990, 500)


def test_a_pod_of_several_containers_has_their_sum(tree, limits, slam):
    tree.sandbox(slam)
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    assert sidecar.parent == slam.parent
    limits.plan({slam: 800})
    assert (tree.limit(slam.parent), tree.limit(sidecar)) == (900, 100)


def test_a_container_that_joins_a_pod_between_two_plans_counts(tree, limits, slam):
    limits.plan({slam: 700})
    tree.container(CHAT, limit=100, uid="uid-a")
    limits.plan({slam: 800})
    assert tree.limit(slam.parent) == 900


def test_pod_limit_lowered_by_others_is_raised_again(tree, limits, slam):
    limits.plan({slam: 800})
    write(tree, limits, slam, 800)
    limits.plan({slam: 700})
    write(tree, limits, slam.parent, 600)
    assert tree.limit(slam.parent) == 700


def test_a_container_that_left_its_pod_no_longer_counts(tree, limits, slam):
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    limits.plan({slam: 700})
    shutil.rmtree(sidecar)
    limits.plan({slam: 850})
    assert tree.limit(slam.parent) == 850


def test_a_pod_without_limit_stays_without(tree, limits, slam):
    tree.container(CHAT, limit=None, uid="uid-a")
    limits.plan({slam: 800})
    assert tree.limit(slam.parent) is None


def test_a_pod_that_a_late_resize_lowered_grows_again(tree, limits, slam):
    limits.plan({slam: 800})
    write(tree, limits, slam.parent, 500)
    assert tree.limit(slam.parent) == 800


def test_a_pod_is_not_lowered_below_its_containers(tree, limits, slam):
    limits.plan({slam: 800})
    tree.set(slam, 700)
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (700, 700)


def test_journaled_weights_do_not_hold_the_pods_limit(tree, limits, slam):
    limits.plan({slam: 990})
    limits.ledger.intend(tree.weight_file(slam), POLICY, now="2", ours="100")
    write(tree, limits, slam, 990)
    assert tree.limit_file(slam.parent) not in limits.ledger.entries


def test_pod_limit_is_left_to_the_kubelet_once_confirmed(tree, limits, slam, journal):
    """It does not write a pod's limit that is right already."""
    limits.plan({slam: 900})
    write(tree, limits, slam, 900)
    *_, last = [line for line in journal.read_text().splitlines() if str(tree.limit_file(slam.parent)) in line]
    assert last.endswith(",null]")


def test_a_pod_is_undone_while_one_container_awaits_the_api(tree, limits, slam):
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    limits.plan({slam: 900, sidecar: 50})
    assert tree.limit(slam.parent) == 950
    write(tree, limits, sidecar, 50)
    limits.release(POLICY, leave_agreed=True)
    assert (tree.limit(slam), tree.limit(sidecar), tree.limit(slam.parent)) == (500, 50, 600)
