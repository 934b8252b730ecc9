"""What others write, what can't be written, and what is left when a policy goes."""

from __future__ import annotations

import os
from math import inf
from time import monotonic
from typing import TYPE_CHECKING

import pytest

from tests.agent.builders import CHAT, POLICY, SPEECH, a_message, a_target

if TYPE_CHECKING:
    from contextpolicy.cluster.agent_reports import Confirmation
from tests.agent.weighted_plans.node import ACTIVE, ASLEEP, refuse


def test_limits_and_weights_overwritten_by_the_kubelet_are_rewritten(node):
    node.plan(ACTIVE, ASLEEP, held=True)
    node.wait(1)
    node.tree.set(node.speech, 300)
    node.tree.set_weight(node.speech, 77)
    for path in (node.tree.limit_file(node.speech), node.tree.weight_file(node.speech)):
        node.agent.on_other_write(path, monotonic())
    assert (node.limits(), node.weights()) == ((500, 10), node.expected(1500, 0))


def test_every_written_weight_file_is_watched(node):
    node.plan(ACTIVE, ASLEEP)
    groups = [node.slam, node.slam.parent, node.slam.parent.parent]
    assert {node.tree.weight_file(group) for group in groups} <= node.watch.paths


@pytest.mark.parametrize("seconds", [0, 1])
def test_deleted_policy_leaves_no_trace_before_or_after_the_drain(node, seconds):
    before = node.limits(), node.weights(), node.tree.weight(node.slam.parent.parent)
    node.plan(ACTIVE, ASLEEP)
    node.wait(seconds)
    node.agent.hear(POLICY, None)
    node.wait(1)
    assert (node.limits(), node.weights(), node.tree.weight(node.slam.parent.parent)) == before


def test_duplicate_write_reports_undo_nothing(node):
    """A resize writes twice, systemd for itself and the runtime; both reports wait while ours is put back."""
    before = node.everything()
    node.plan(ACTIVE, ASLEEP, held=True)
    node.wait(1)
    files = [*map(node.tree.weight_file, node.groups()), node.tree.limit_file(node.speech)]
    node.foreign(before)
    heard = monotonic()
    for path in files + files:
        node.agent.on_other_write(path, heard)
    assert (node.limits(), node.weights()) == ((500, 10), node.expected(1500, 0))
    node.agent.stop()
    assert node.everything() == before


def test_lost_reports_undo_nothing(node):
    before = node.everything()
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    for path in list(node.watch.paths):
        node.agent.on_other_write(path, -inf)
    node.agent.hear(POLICY, None)
    assert node.everything() == before


def test_a_plan_published_again_for_one_container_keeps_what_others_wrote_on_another(node):
    """As when slam has restarted: no new plan, so speech's owner keeps its value."""
    node.plan(ACTIVE, ASLEEP)
    node.wait(1)
    node.kubelet(node.speech, 300)
    restarted = node.tree.container(CHAT)
    targets = a_target(CHAT, weight=1.5, quota=0.2), a_target(SPEECH, task="speech", weight=0, quota=0.01)
    node.agent.hear(POLICY, a_message(*targets, edition=1, suspended=("speech",)))
    assert (node.tree.limit(restarted), node.tree.limit(node.speech)) == (200, 300)


def test_a_quota_that_fails_later_is_reported(node, monkeypatch):
    late: list[Confirmation] = []
    node.agent.late.subscribe(late.append)
    node.plan(ACTIVE, ASLEEP)
    with monkeypatch.context() as broken:
        broken.setattr(os, "pwrite", refuse)
        node.wait(1)
    assert [(said.stamp, list(said.failed.values())) for said in late] == [((1, 1, 0), ["Forbidden"])]
    node.repeat(ACTIVE, ASLEEP)
    assert node.limits() == (500, 10)


def test_a_value_that_cannot_be_put_back_is_reported_and_tried_again(node, monkeypatch):
    late: list[Confirmation] = []
    node.agent.late.subscribe(late.append)
    node.plan(ACTIVE, ASLEEP, held=True)
    node.wait(1)
    with monkeypatch.context() as broken:
        broken.setattr(os, "pwrite", refuse)
        node.kubelet(node.speech, 500)
    assert [list(said.failed) for said in late] == [[f"containerd://{SPEECH}"]]
    node.repeat(ACTIVE, ASLEEP, held=True)
    assert node.limits() == (500, 10)


def test_weights_written_while_no_agent_ran_are_restored(node):
    node.plan(ACTIVE, (0.3, 0.5))
    node.tree.set_weight(node.slam, 55)
    node.tree.set_weight(node.slam.parent, 56)
    node.start()
    node.plan(ACTIVE, (0.3, 0.5))
    node.agent.hear(POLICY, None)
    assert (node.tree.weight(node.slam), node.tree.weight(node.slam.parent)) == (55, 56)


def test_weights_that_follow_a_score_leave_the_journal_small(node):
    for step in range(400):
        node.plan((round(0.3 + step * 0.001, 3), 0.5), (0.3, 0.5))
    before = node.journal.stat().st_size
    node.plan((1.2, 0.5), (0.3, 0.5))
    assert node.journal.stat().st_size - before < 2000


def test_guaranteed_pods_leave_the_top_weight_unwritten(node):
    before = node.tree.weight(node.tree.layout.top)
    node.plan((0.3, 0.5), (0.3, 0.5), qos="Guaranteed")
    assert node.tree.weight(node.tree.layout.top) == before


def test_a_limit_that_systemd_has_rounded_is_left_as_it_is(node):
    node.tree.set(node.slam, 340)
    node.plan((0.5, 0.333), (0.3, 0.5), original=0.333)
    assert node.limits() == (340, 500)
