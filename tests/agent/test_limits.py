"""CPU limits: ahead of the resize, in agreement with it, and undone without it."""

from __future__ import annotations

import shutil
from time import monotonic

import pytest

from contextpolicy.agent.cgroup_paths import Driver
from contextpolicy.agent.control_files import CFS, ControlFiles
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.limits import Limits
from tests.agent.builders import CHAT, POLICY, SLAM, SPEECH, Tree

OTHER = "robot/other"


@pytest.fixture(params=[(1, Driver.CGROUPFS), (1, Driver.SYSTEMD), (2, Driver.CGROUPFS), (2, Driver.SYSTEMD)], ids=str)
def tree(request, tmp_path):
    return Tree(tmp_path / "cgroup", *request.param)


@pytest.fixture
def ledger(tmp_path):
    return Ledger(tmp_path / "ledger.json")


@pytest.fixture
def limits(tree, ledger):
    return Limits(ControlFiles(CFS[tree.version]), ledger)


@pytest.fixture
def slam(tree):
    return tree.container(SLAM)


@pytest.fixture
def speech(tree):
    return tree.container(SPEECH)


def resize(tree, limits, group, limit):
    """The kubelet writes and the watch tells."""
    tree.set(group, limit)
    limits.on_other_write(tree.limit_file(group), monotonic())


def test_shares_become_limits_at_once(tree, limits, slam, speech):
    limits.apply(POLICY, {slam: 990, speech: 10})
    assert (tree.limit(slam), tree.limit(speech)) == (990, 10)


def test_a_pod_grows_with_its_container_and_is_left_to_the_kubelet_otherwise(tree, limits, slam, speech):
    limits.apply(POLICY, {slam: 990, speech: 10})
    assert (tree.limit(slam.parent), tree.limit(speech.parent)) == (990, 500)


def test_a_pod_of_several_containers_has_their_sum(tree, limits, slam):
    tree.sandbox(slam)
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    assert sidecar.parent == slam.parent
    limits.apply(POLICY, {slam: 800})
    assert (tree.limit(slam.parent), tree.limit(sidecar)) == (900, 100)


def test_a_container_that_joins_a_pod_between_two_plans_counts(tree, limits, slam):
    limits.apply(POLICY, {slam: 700})
    tree.container(CHAT, limit=100, uid="uid-a")
    limits.apply(POLICY, {slam: 800})
    assert tree.limit(slam.parent) == 900


def test_a_pod_that_somebody_lowered_is_raised_again_where_no_container_rises(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    resize(tree, limits, slam, 800)
    limits.apply(POLICY, {slam: 700})
    resize(tree, limits, slam.parent, 600)
    assert tree.limit(slam.parent) == 700


def test_a_container_that_left_its_pod_counts_no_more(tree, limits, slam):
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    limits.apply(POLICY, {slam: 700})
    shutil.rmtree(sidecar)
    limits.apply(POLICY, {slam: 850})
    assert tree.limit(slam.parent) == 850


def test_a_pod_without_limit_stays_without(tree, limits, slam):
    tree.container(CHAT, limit=None, uid="uid-a")
    limits.apply(POLICY, {slam: 800})
    assert tree.limit(slam.parent) is None


def test_a_resize_that_agrees_leaves_nothing_to_undo(tree, limits, ledger, slam):
    limits.apply(POLICY, {slam: 800})
    assert ledger.entries
    resize(tree, limits, slam, 800)
    assert ledger.entries == {}
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (800, 800)


def test_without_the_resize_it_is_undone(tree, limits, ledger, slam, speech):
    limits.apply(POLICY, {slam: 800, speech: 10})
    limits.release(POLICY)
    for group in (slam, speech, slam.parent, speech.parent):
        assert tree.limit(group) == 500
    assert ledger.entries == {}


def test_a_resize_of_an_earlier_plan_is_overwritten_and_remembered(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    limits.apply(POLICY, {slam: 100})
    resize(tree, limits, slam, 800)
    assert tree.limit(slam) == 100
    limits.release(POLICY)
    assert tree.limit(slam) == 800


def test_after_the_newest_plan_is_confirmed_nothing_is_fought(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    limits.apply(POLICY, {slam: 100})
    resize(tree, limits, slam, 100)
    resize(tree, limits, slam, 800)
    assert tree.limit(slam) == 800


def test_another_owners_value_stays_until_the_next_plan(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    resize(tree, limits, slam, 300)
    assert tree.limit(slam) == 300
    limits.apply(POLICY, {slam: 900})
    assert tree.limit(slam) == 900
    limits.release(POLICY)
    assert tree.limit(slam) == 300


def test_what_was_there_before_is_no_new_decision(tree, limits, slam):
    """At `daemon-reload` and `set-property` systemd writes what it was last told, that is before our write."""
    limits.apply(POLICY, {slam: 800})
    for _ in range(2):
        resize(tree, limits, slam, 500)
        assert (tree.limit(slam), tree.limit(slam.parent)) == (800, 800)
    resize(tree, limits, slam, 800)
    limits.release(POLICY)
    assert tree.limit(slam) == 800


def test_systemds_writes_in_the_middle_can_still_be_undone(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    resize(tree, limits, slam.parent, 500)
    resize(tree, limits, slam, 500)
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_a_pod_that_a_late_resize_lowered_grows_again(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    resize(tree, limits, slam.parent, 500)
    assert tree.limit(slam.parent) == 800


def test_a_pod_is_not_lowered_below_its_containers(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    tree.set(slam, 700)
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (700, 800)


def test_a_container_that_the_plan_no_longer_names_is_undone(tree, limits, slam, speech):
    limits.apply(POLICY, {slam: 800, speech: 10})
    limits.apply(POLICY, {slam: 800})
    assert (tree.limit(slam), tree.limit(speech)) == (800, 500)


def test_policies_do_not_undo_each_other(tree, limits, slam, speech):
    limits.apply(POLICY, {slam: 800})
    limits.apply(OTHER, {speech: 10})
    limits.release(OTHER)
    assert (tree.limit(slam), tree.limit(speech)) == (800, 500)


def test_a_container_that_ended_is_forgotten(tree, limits, ledger, slam, speech):
    limits.apply(POLICY, {slam: 800, speech: 10})
    for path in (*slam.iterdir(), slam):
        path.unlink() if path.is_file() else path.rmdir()
    limits.apply(POLICY, {speech: 20})
    assert tree.limit(speech) == 20
    assert not any(path.is_relative_to(slam) for path in ledger.entries)


def test_a_held_limit_is_kept_against_anybody_and_still_undone(tree, limits, slam):
    limits.apply(POLICY, {slam: 10}, [slam])
    resize(tree, limits, slam, 300)
    assert tree.limit(slam) == 10
    limits.release(POLICY)
    assert tree.limit(slam) == 300


def test_what_the_api_cannot_have_is_held_beside_what_it_can(tree, limits, slam, speech):
    """The kubelet writes what the API has: the request of the one, the very limit of the other."""
    limits.apply(POLICY, {slam: 10, speech: 400}, [slam])
    resize(tree, limits, slam, 300)
    resize(tree, limits, speech, 400)
    resize(tree, limits, speech, 450)
    assert (tree.limit(slam), tree.limit(speech)) == (10, 450)


def test_a_held_limit_that_was_there_already_is_kept_too(tree, limits, slam):
    tree.set(slam, 10)
    limits.apply(POLICY, {slam: 10}, [slam])
    resize(tree, limits, slam, 300)
    assert tree.limit(slam) == 10


def test_a_container_without_a_limit_is_capped_and_freed_again(tree, limits):
    free = tree.container(CHAT, limit=None)
    limits.apply(POLICY, {free: 10})
    assert (tree.limit(free), tree.limit(free.parent)) == (10, None)
    limits.apply(POLICY, {free: None})
    assert (tree.limit(free), tree.limit(free.parent)) == (None, None)


def test_weights_in_the_journal_keep_no_limit_of_a_pod(tree, limits, ledger, slam):
    limits.apply(POLICY, {slam: 990})
    ledger.intend(tree.weight_file(slam), POLICY, now="2", ours="100")
    resize(tree, limits, slam, 990)
    assert tree.limit_file(slam.parent) not in ledger.entries


def told_late(tree, limits, group):
    """The watch tells of a write that the agent has overwritten meanwhile."""
    limits.on_other_write(tree.limit_file(group), monotonic())


def test_a_resize_that_a_plan_overtakes_is_no_confirmation(tree, limits, slam):
    limits.apply(POLICY, {slam: 800})
    resize(tree, limits, slam, 800)
    tree.set(slam, 500)
    limits.apply(POLICY, {slam: 1000})
    told_late(tree, limits, slam)
    assert tree.limit(slam) == 1000
    limits.release(POLICY)
    assert tree.limit(slam) == 500


@pytest.mark.parametrize("held", [False, True])
def test_a_resize_that_a_second_plan_overtakes_is_what_comes_back(tree, limits, slam, held):
    kept = [slam] if held else []
    limits.apply(POLICY, {slam: 20}, kept)
    tree.set(slam, 300)
    limits.apply(POLICY, {slam: 10}, kept)
    told_late(tree, limits, slam)
    assert tree.limit(slam) == 10
    limits.release(POLICY)
    assert tree.limit(slam) == 300


def test_a_resize_between_ledger_and_write_is_what_comes_back(tree, limits, ledger, slam, monkeypatch):
    save = ledger.save

    def overtaken():
        monkeypatch.setattr(ledger, "save", save)
        save()
        tree.set(slam, 300)

    limits.apply(POLICY, {slam: 900})
    monkeypatch.setattr(ledger, "save", overtaken)
    limits.apply(POLICY, {slam: 800})
    told_late(tree, limits, slam)
    assert tree.limit(slam) == 800
    limits.release(POLICY)
    assert tree.limit(slam) == 300


def test_the_next_plan_tells_whether_the_overtaking_one_was_confirmed(tree, limits, ledger, slam):
    limits.apply(POLICY, {slam: 800})
    tree.set(slam, 300)
    limits.apply(POLICY, {slam: 900})
    told_late(tree, limits, slam)
    resize(tree, limits, slam, 900)
    limits.settle(slam, 900)
    assert tree.limit_file(slam) not in ledger.entries
    limits.apply(POLICY, {slam: 900})
    limits.release(POLICY)
    assert tree.limit(slam) == 900


def test_after_an_overtaken_resize_the_next_one_confirms_the_next_plan(tree, limits, ledger, slam):
    limits.apply(POLICY, {slam: 800})
    tree.set(slam, 300)
    limits.apply(POLICY, {slam: 900})
    told_late(tree, limits, slam)
    limits.apply(POLICY, {slam: 700})
    resize(tree, limits, slam, 700)
    assert tree.limit_file(slam) not in ledger.entries


def test_another_owners_value_stays_also_if_another_files_write_is_told_first(tree, limits, slam):
    """The kubelet writes a pod's limit just before its container's."""
    limits.apply(POLICY, {slam: 800})
    tree.set(slam, 300)
    resize(tree, limits, slam.parent, 500)
    assert tree.limit(slam) == 300
    told_late(tree, limits, slam)
    assert tree.limit(slam) == 300


@pytest.fixture
def heir(tree, limits, slam, tmp_path):
    """A second life, after the first was killed with an unconfirmed limit of 800 in force."""
    limits.apply(POLICY, {slam: 800})
    ledger = Ledger(tmp_path / "ledger.json")
    ledger.load()
    return Limits(ControlFiles(CFS[tree.version]), ledger)


def test_after_a_kill_an_unconfirmed_limit_is_undone(tree, heir, slam):
    heir.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_after_a_kill_the_same_plan_goes_on(tree, heir, slam):
    heir.apply(POLICY, {slam: 800})
    assert tree.limit(slam) == 800
    heir.release(POLICY)
    assert tree.limit(slam) == 500


def test_after_a_kill_the_plan_tells_what_was_confirmed_meanwhile(tree, heir, slam):
    heir.settle(slam, 800)
    heir.apply(POLICY, {slam: 800})
    heir.release(POLICY)
    assert tree.limit(slam) == 800


def test_after_a_kill_a_limit_that_somebody_changed_meanwhile_stays(tree, heir, slam):
    tree.set(slam, 300)
    heir.release(POLICY)
    assert tree.limit(slam) == 300
