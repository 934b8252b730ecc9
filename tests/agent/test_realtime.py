"""Realtime budgets and threads: given, changed and taken back, on both kinds of files."""

from __future__ import annotations

import os

import pytest

from contextpolicy.agent import threads
from contextpolicy.agent.cgroup_paths import Driver
from contextpolicy.agent.control_files import REALTIME, ControlFile, ControlFiles
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.node_orders import Manner
from contextpolicy.agent.open_files import Unwatched
from contextpolicy.agent.realtime import Realtime
from contextpolicy.errors import ActuationError
from contextpolicy.policy.spec import RealtimePolicy
from tests.agent.builders import CHAT, POLICY, SLAM, Tree

OTHER = "robot/other"
MANNER = Manner()
TURNS, QUEUE = (os.SCHED_RR, 10), (os.SCHED_FIFO, 10)


@pytest.fixture(params=[(1, Driver.CGROUPFS), (2, Driver.SYSTEMD)], ids=str)
def tree(request, tmp_path):
    return Tree(tmp_path / "cgroup", *request.param)


@pytest.fixture
def ledger(tmp_path):
    return Ledger(tmp_path / "ledger.json")


@pytest.fixture
def realtime(tree, ledger, scheduled):  # noqa: ARG001 - no test may change real threads
    return Realtime(tree.layout, ControlFiles(REALTIME[tree.version], Unwatched()), ledger, 10)


@pytest.fixture
def scheduled(monkeypatch):
    """Which groups' threads are in realtime, instead of real threads."""
    groups = {}
    monkeypatch.setattr(
        threads, "make_realtime", lambda group, _, priority, policy: groups.update({group: (policy, priority)})
    )
    monkeypatch.setattr(threads, "make_ordinary", lambda group, _: groups.pop(group, None))
    return groups


def files(group):
    return {
        path.name: path.read_text().partition("\n")[0] for path in group.iterdir() if path.name.startswith("cpu.rt")
    }


def period(tree, group):
    form = REALTIME[tree.version]
    return int((group / (form.period_file or form.file)).read_text().partition("\n")[0].split()[-1])


def budgets(tree, *groups):
    return [tree.budget(group) for group in groups]


def test_budgets_reach_from_the_top_to_the_container(tree, realtime, scheduled, slam, speech):
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    assert budgets(tree, slam, slam.parent, speech, speech.parent) == [600, 600, 350, 350]
    assert budgets(tree, slam.parent.parent, tree.layout.top) == [950, 950]
    assert scheduled == {slam: TURNS, speech: TURNS}


def test_budgets_follow_the_plan(tree, realtime, slam, speech):
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    realtime.apply(POLICY, {slam: 100, speech: 850}, MANNER)
    assert budgets(tree, slam, slam.parent, speech, tree.layout.top) == [100, 100, 850, 950]


def test_containers_have_a_shorter_period_and_get_the_kernels_back(tree, realtime, slam):
    before = files(slam)
    realtime.apply(POLICY, {slam: 600}, MANNER)
    time = "60000" if tree.version == 1 else "60000 100000"
    assert files(slam)[REALTIME[tree.version].file] == time
    assert "100000" in files(slam)[REALTIME[tree.version].period_file or "cpu.rt.max"]
    assert "1000000" in files(slam.parent)[REALTIME[tree.version].period_file or "cpu.rt.max"]
    realtime.release(POLICY)
    assert files(slam) == before
    assert realtime._ledger.entries == {}


SECOND, FIFO = Manner(1_000_000), Manner(policy=RealtimePolicy.FIFO)


def test_period_of_one_second_is_supported(tree, realtime, slam):
    realtime.apply(POLICY, {slam: 600}, SECOND)
    assert (tree.budget(slam), period(tree, slam)) == (600, 1_000_000)
    realtime.release(POLICY)
    assert (tree.budget(slam), period(tree, slam)) == (0, 1_000_000)


@pytest.fixture
def seen(tree, slam, monkeypatch):
    """The container's budget after each write."""
    budgets = []
    for name in ("write", "set_period"):
        original = getattr(ControlFile, name)

        def noting(file, value, original=original):
            original(file, value)
            budgets.append(tree.budget(slam))

        monkeypatch.setattr(ControlFile, name, noting)
    return budgets


@pytest.mark.parametrize("share", [600, 300, 900])
@pytest.mark.parametrize("change", [(MANNER, SECOND), (SECOND, MANNER)])
def test_changing_the_period_never_exceeds_either_budget(tree, realtime, seen, share, change):
    slam = tree.layout.container("Burstable", "uid-a", f"containerd://{SLAM}")
    realtime.apply(POLICY, {slam: 600}, change[0])
    realtime.apply(POLICY, {slam: share}, change[1])
    assert (tree.budget(slam), period(tree, slam)) == (share, change[1].period)
    assert max(seen) <= max(600, share)
    realtime.release(POLICY)
    assert (tree.budget(slam), period(tree, slam)) == (0, 1_000_000)
    assert realtime._ledger.entries == {}


def test_policies_have_periods_of_their_own(tree, realtime, slam, speech):
    realtime.apply(POLICY, {slam: 600}, MANNER)
    realtime.apply(OTHER, {speech: 350}, SECOND)
    realtime.apply(POLICY, {slam: 500}, MANNER)
    assert (period(tree, slam), period(tree, speech)) == (100_000, 1_000_000)
    assert budgets(tree, slam, speech, tree.layout.top) == [500, 350, 850]


def test_threads_can_use_fifo_instead_of_round_robin(realtime, scheduled, slam):
    realtime.apply(POLICY, {slam: 600}, MANNER)
    realtime.apply(POLICY, {slam: 600}, FIFO)
    assert scheduled == {slam: QUEUE}
    realtime.apply(POLICY, {slam: 600}, MANNER)
    assert scheduled == {slam: TURNS}


def test_a_suspended_task_leaves_realtime_and_keeps_its_budget(tree, realtime, scheduled, slam, speech):
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    realtime.apply(POLICY, {slam: 949, speech: 1}, MANNER, [speech])
    assert scheduled == {slam: TURNS}
    assert tree.budget(speech) == 1
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    assert scheduled == {slam: TURNS, speech: TURNS}


def test_all_is_undone(tree, realtime, scheduled, slam, speech):
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    realtime.release(POLICY)
    assert budgets(tree, slam, slam.parent, speech, speech.parent, slam.parent.parent, tree.layout.top) == [0] * 6
    assert scheduled == {}
    assert realtime._ledger.entries == {}


def test_a_container_that_the_plan_no_longer_names_leaves_realtime(tree, realtime, scheduled, slam, speech):
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    realtime.apply(POLICY, {slam: 900}, MANNER)
    assert budgets(tree, slam, speech, speech.parent, tree.layout.top) == [900, 0, 0, 900]
    assert scheduled == {slam: TURNS}


def test_guaranteed_pods_are_directly_below_the_top(tree, realtime, slam):
    chat = tree.container(CHAT, qos="Guaranteed")
    realtime.apply(POLICY, {slam: 600, chat: 350}, MANNER)
    assert budgets(tree, chat.parent, slam.parent.parent, tree.layout.top) == [350, 600, 950]


def test_external_budget_of_parent_groups_is_kept(tree, realtime, slam):
    name = REALTIME[tree.version].file
    text = "400000\n" if tree.version == 1 else "400000 1000000\n"
    (tree.layout.top / name).write_text(text)
    realtime.apply(POLICY, {slam: 300}, MANNER)
    assert tree.budget(tree.layout.top) == 400
    realtime.apply(POLICY, {slam: 600}, MANNER)
    assert tree.budget(tree.layout.top) == 600
    realtime.release(POLICY)
    assert tree.budget(tree.layout.top) == 400


def test_budgets_of_policies_add_up_and_end_separately(tree, realtime, scheduled, slam, speech):
    realtime.apply(POLICY, {slam: 600}, MANNER)
    realtime.apply(OTHER, {speech: 350}, MANNER)
    assert tree.budget(tree.layout.top) == 950
    realtime.release(POLICY)
    assert budgets(tree, slam, speech, tree.layout.top) == [0, 350, 350]
    assert scheduled == {speech: TURNS}


def test_a_container_that_ended_frees_its_part(tree, realtime, slam, speech):
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    for path in (*slam.iterdir(), slam):
        path.unlink() if path.is_file() else path.rmdir()
    realtime.apply(POLICY, {slam: 600, speech: 350}, MANNER)
    assert budgets(tree, speech, tree.layout.top) == [350, 350]


def test_a_refusal_of_the_kernel_is_reported_and_the_rest_continues(realtime, scheduled, monkeypatch, slam):
    def no_room(file, text):
        if file.path.parent == slam.parent.parent.parent:
            raise ActuationError("OutOfBounds", f"no room for {text}", retriable=False)

    monkeypatch.setattr(ControlFile, "write", no_room)
    failures = realtime.apply(POLICY, {slam: 600}, MANNER)
    assert {group: error.reason for group, error in failures.items()} == {slam.parent.parent.parent: "OutOfBounds"}
    assert scheduled == {slam: TURNS}


def test_thread_created_during_release_is_retried(tree, realtime, monkeypatch, slam):
    def busy(file, text):
        if text.startswith("0") and file.path.parent == slam and refusals_left:
            refusals_left.pop()
            raise ActuationError("Busy", "a realtime thread", retriable=True)
        write(file, text)

    write, refusals_left = ControlFile.write, [1, 2]
    monkeypatch.setattr(ControlFile, "write", busy)
    realtime.apply(POLICY, {slam: 600}, MANNER)
    assert realtime.release(POLICY) == {}
    assert tree.budget(slam) == 0


@pytest.fixture
def heir(tree, realtime, slam, speech, tmp_path):
    """A second life, after the first was killed while two policies had realtime budgets."""
    realtime.apply(POLICY, {slam: 600}, MANNER)
    realtime.apply(OTHER, {speech: 300}, MANNER)
    ledger = Ledger(tmp_path / "ledger.json")
    ledger.load()
    return Realtime(tree.layout, ControlFiles(REALTIME[tree.version], Unwatched()), ledger, 10)


def test_after_a_kill_all_can_be_undone(tree, heir, scheduled, slam, speech):
    untouched = files(tree.container(CHAT))
    heir.release(POLICY)
    heir.release(OTHER)
    assert budgets(tree, slam, slam.parent, speech, speech.parent, slam.parent.parent, tree.layout.top) == [0] * 6
    assert files(slam) == files(speech) == untouched
    assert scheduled == {}


def test_after_a_kill_one_policys_plan_does_not_undo_the_others(tree, heir, scheduled, slam, speech):
    heir.apply(POLICY, {slam: 500}, MANNER)
    assert budgets(tree, slam, speech, tree.layout.top) == [500, 300, 800]
    assert scheduled == {slam: TURNS, speech: TURNS}
    heir.apply(OTHER, {speech: 450}, MANNER)
    assert budgets(tree, slam, speech, tree.layout.top) == [500, 450, 950]
