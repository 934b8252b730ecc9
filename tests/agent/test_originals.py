"""What every limit goes back to: the container's original, also where the API agreed to something else since."""

from __future__ import annotations

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
def live(tree, tmp_path):
    """Begin an agent's life; the journal lasts."""

    def live():
        ledger = Ledger(tmp_path / "journal")
        ledger.load()
        return Limits(ControlFiles(CFS[tree.version]), ledger)

    return live


@pytest.fixture
def limits(live):
    return live()


@pytest.fixture
def journal(tmp_path):
    return tmp_path / "journal"


@pytest.fixture
def slam(tree):
    return tree.container(SLAM)


def resize(tree, limits, group, limit):
    """The kubelet writes a container that is alone in its pod: the pod first where it rises, else the container."""
    groups = [group.parent, group] if limit > tree.limit(group.parent) else [group, group.parent]
    for each in groups:
        tree.set(each, limit)
        limits.on_other_write(tree.limit_file(each), monotonic())


def test_what_the_api_has_is_undone_as_well(tree, limits, slam, journal):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)
    assert journal.read_text() == ""


def test_a_rise_that_the_api_has_is_undone_as_well(tree, limits, slam):
    limits.apply(POLICY, {slam: 900}, originals={slam: 500})
    resize(tree, limits, slam, 900)
    limits.release(POLICY)
    assert tree.limit(slam) == 500


def test_the_next_life_undoes_what_the_api_had_before_the_first_was_killed(tree, limits, live, slam):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    live().release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_a_life_that_finds_the_plan_in_force_can_undo_it(tree, live, slam):
    tree.set(slam, 10)
    tree.set(slam.parent, 10)
    live().apply(POLICY, {slam: 10}, originals={slam: 500})
    live().release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_a_container_that_the_plan_no_longer_names_gets_its_original(tree, limits, slam):
    speech = tree.container(SPEECH)
    limits.apply(POLICY, {slam: 10, speech: 20}, originals={slam: 500, speech: 500})
    resize(tree, limits, slam, 10)
    limits.apply(POLICY, {speech: 20}, originals={speech: 500})
    assert (tree.limit(slam), tree.limit(speech)) == (500, 20)


def test_at_the_agents_end_what_the_api_has_stays_and_the_rest_is_undone(tree, limits, slam, journal):
    speech = tree.container(SPEECH)
    limits.apply(POLICY, {slam: 10, speech: 20}, originals={slam: 500, speech: 400})
    resize(tree, limits, slam, 10)
    limits.release(POLICY, leave_agreed=True)
    assert (tree.limit(slam), tree.limit(speech)) == (10, 500)
    assert journal.read_text() == ""


def test_a_change_on_top_of_what_the_api_has(tree, limits, slam):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    limits.apply(POLICY, {slam: 300}, originals={slam: 500})
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 10


def test_the_api_agreeing_to_the_original_leaves_nothing_to_undo(tree, limits, slam, journal):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    limits.apply(POLICY, {slam: 500}, originals={slam: 500})
    resize(tree, limits, slam, 500)
    assert journal.read_text() == ""


def test_an_owners_decision_is_not_undone(tree, limits, slam):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    resize(tree, limits, slam, 300)
    limits.release(POLICY)
    assert tree.limit(slam) == 300


def test_an_owners_decision_while_no_agent_lived_is_not_undone(tree, limits, live, slam):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    tree.set(slam, 300)
    live().release(POLICY)
    assert tree.limit(slam) == 300


def test_what_the_operator_puts_back_after_an_owners_decision_can_be_undone(tree, limits, slam):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    resize(tree, limits, slam, 300)
    resize(tree, limits, slam, 10)
    limits.release(POLICY)
    assert tree.limit(slam) == 500


def test_a_held_limit_goes_back_to_the_original_not_to_what_the_api_has(tree, limits, slam):
    limits.apply(POLICY, {slam: 10}, [slam], {slam: 500})
    resize(tree, limits, slam, 100)
    assert tree.limit(slam) == 10
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(slam.parent)) == (500, 500)


def test_a_held_limit_that_the_plan_found_in_force_goes_back_too(tree, limits, slam):
    tree.set(slam, 10)
    limits.apply(POLICY, {slam: 10}, [slam], {slam: 500})
    resize(tree, limits, slam, 100)
    assert tree.limit(slam) == 10
    limits.release(POLICY)
    assert tree.limit(slam) == 500


def test_a_container_that_had_no_limit_has_none_again(tree, limits):
    free = tree.container(CHAT, limit=None)
    limits.apply(POLICY, {free: 10}, [free], {free: None})
    limits.release(POLICY)
    assert (tree.limit(free), tree.limit(free.parent)) == (None, None)


def test_beside_a_container_of_no_policy(tree, limits, slam):
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    for group, limit in ((slam, 10), (slam.parent, 110)):
        tree.set(group, limit)
        limits.on_other_write(tree.limit_file(group), monotonic())
    limits.release(POLICY)
    assert (tree.limit(slam), tree.limit(sidecar), tree.limit(slam.parent)) == (500, 100, 600)


def test_a_policy_that_takes_a_container_over_at_the_same_limit_has_it_undone_by_nobody_else(tree, limits, slam):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    limits.apply(OTHER, {slam: 10}, originals={slam: 500})
    limits.release(POLICY)
    assert tree.limit(slam) == 10
    limits.release(OTHER)
    assert tree.limit(slam) == 500


def test_what_repeats_costs_the_journal_nothing(tree, limits, slam, journal):
    limits.apply(POLICY, {slam: 10}, originals={slam: 500})
    resize(tree, limits, slam, 10)
    before = journal.read_text()
    for _ in range(3):
        limits.apply(POLICY, {slam: 10}, originals={slam: 500})
        resize(tree, limits, slam, 10)
    assert journal.read_text() == before


def test_a_pod_is_still_undone_while_the_api_has_yet_to_agree_on_one_of_its_containers(tree, limits, slam):
    sidecar = tree.container(CHAT, limit=100, uid="uid-a")
    limits.apply(POLICY, {slam: 900, sidecar: 50}, originals={slam: 500, sidecar: 100})
    assert tree.limit(slam.parent) == 950
    tree.set(sidecar, 50)
    limits.on_other_write(tree.limit_file(sidecar), monotonic())
    limits.release(POLICY, leave_agreed=True)
    assert (tree.limit(slam), tree.limit(sidecar), tree.limit(slam.parent)) == (500, 50, 600)


def test_a_pod_whose_container_the_api_agreed_on_is_the_kubelets(tree, limits, slam, journal):
    """It does not write a pod's limit that is right already."""
    limits.apply(POLICY, {slam: 900}, originals={slam: 500})
    tree.set(slam, 900)
    limits.on_other_write(tree.limit_file(slam), monotonic())
    *_, last = [line for line in journal.read_text().splitlines() if str(tree.limit_file(slam.parent)) in line]
    assert last.endswith(",null]")
