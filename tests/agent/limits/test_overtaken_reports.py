"""Reports of writes that a plan overtakes."""

from __future__ import annotations

import pytest

from tests.agent.builders import POLICY
from tests.agent.limits.planned import report_late, write


def test_overtaken_resize_does_not_confirm_the_plan(tree, limits, slam):
    limits.plan({slam: 800})
    write(tree, limits, slam, 800)
    tree.set(slam, 500)
    limits.plan({slam: 1000})
    report_late(tree, limits, slam)
    assert tree.limit(slam) == 1000
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 500


@pytest.mark.parametrize("held", [False, True])
def test_resize_between_two_plans_becomes_the_restored_limit(tree, limits, slam, held):
    kept = [slam] if held else []
    limits.plan({slam: 20}, kept)
    tree.set(slam, 300)
    limits.plan({slam: 10}, kept)
    report_late(tree, limits, slam)
    assert tree.limit(slam) == 10
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 300


def test_resize_between_journal_and_write_becomes_the_restored_limit(tree, limits, slam, monkeypatch):
    save = limits.ledger.save

    def overtaken():
        monkeypatch.setattr(limits.ledger, "save", save)
        save()
        tree.set(slam, 300)

    limits.plan({slam: 900})
    monkeypatch.setattr(limits.ledger, "save", overtaken)
    limits.plan({slam: 800})
    report_late(tree, limits, slam)
    assert tree.limit(slam) == 800
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 300


def agreed(tree, limits, group):
    """Whether the API has what the container should have."""
    return limits.ledger.entries[tree.limit_file(group)].agreed


def test_the_next_plan_shows_whether_the_overtaking_one_was_confirmed(tree, limits, slam):
    limits.plan({slam: 800})
    tree.set(slam, 300)
    limits.plan({slam: 900})
    report_late(tree, limits, slam)
    write(tree, limits, slam, 900)
    assert not agreed(tree, limits, slam)
    limits.settle(slam, 900)
    assert agreed(tree, limits, slam)
    limits.plan({slam: 900})
    limits.release(POLICY, leave_agreed=True)
    assert tree.limit(slam) == 900


def test_after_an_overtaken_resize_the_next_one_confirms_the_next_plan(tree, limits, slam):
    limits.plan({slam: 800})
    tree.set(slam, 300)
    limits.plan({slam: 900})
    report_late(tree, limits, slam)
    limits.plan({slam: 700})
    write(tree, limits, slam, 700)
    assert agreed(tree, limits, slam)


def test_an_external_value_is_kept_if_another_files_write_is_seen_first(tree, limits, slam):
    """The kubelet writes a pod's limit just before its container's."""
    limits.plan({slam: 800})
    tree.set(slam, 300)
    write(tree, limits, slam.parent, 500)
    assert tree.limit(slam) == 300
    report_late(tree, limits, slam)
    assert tree.limit(slam) == 300
