"""What is known of one pod between a patch and the watch."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.actuators.resize.pod_job import Job, Outcome
from contextpolicy.actuators.resize.pod_slot import PodSlot
from contextpolicy.cluster.pods import Cpu, Original, view
from tests.actuators.resize.fake_cluster import UNREACHABLE, refusal
from tests.cluster.builders import a_pod, cpu

POLICY = "lab/robot"
NOW = 1000.0
OLD, NEW = Cpu(100, 500), Cpu(100, 300)
BEFORE = {"slam": Original(POLICY, OLD)}


@pytest.fixture
def slot():
    return PodSlot(view(a_pod()))


def a_job(slot, wanted=NEW, *, restore=False):
    originals = {} if restore else BEFORE
    return Job(POLICY, slot.view, {"slam": wanted}, {"slam": wanted}, originals, note=True, restore=restore)


def carry(slot, outcome, **job):
    """Begin and finish a job."""
    job = a_job(slot, **job)
    slot.begin(job)
    slot.finish(job, outcome, NOW)


def accepted(version=102):
    return Outcome(version=version, noted=True, resized=True)


def shown(  # noqa: PLR0913 - each is a field of its own
    slot, *, spec=NEW, actual=OLD, generation=2, observed=2, version=103, originals=BEFORE
):
    """What the watch shows next."""
    [container] = slot.view.containers
    containers = (replace(container, spec=spec, actual=actual),)
    slot.observe(
        replace(
            slot.view,
            containers=containers,
            generation=generation,
            observed_generation=observed,
            version=version,
            originals=originals,
        ),
        NOW,
    )


def test_while_a_patch_is_under_way_both_limits_may_hold(slot):
    slot.begin(a_job(slot, wanted=Cpu(100, 900)))
    assert slot.highest("slam") == 900
    slot = PodSlot(view(a_pod()))
    slot.begin(a_job(slot))
    assert slot.highest("slam") == 500


def test_an_accepted_patch_is_the_spec_before_the_watch_shows_it(slot):
    carry(slot, accepted())
    assert slot.spec("slam") == NEW
    assert slot.originals == BEFORE
    assert slot.highest("slam") == 500


def test_a_decrease_holds_until_the_kubelet_reports_it(slot):
    carry(slot, accepted())
    shown(slot, observed=1)
    assert slot.highest("slam") == 500
    shown(slot, version=104)
    assert slot.highest("slam") == 500
    shown(slot, actual=NEW, version=105)
    assert slot.highest("slam") == 300


def test_a_resize_that_is_held_back_has_not_passed(slot):
    carry(slot, accepted())
    slot.view = replace(slot.view, pending="Deferred: full")
    shown(slot, actual=NEW)
    assert slot.highest("slam") == 500


def test_old_news_changes_nothing(slot):
    carry(slot, accepted(version=200))
    shown(slot, spec=OLD, generation=1, version=199, originals={})
    assert slot.spec("slam") == NEW
    assert slot.originals == BEFORE


def test_news_that_overtook_the_answer_is_believed(slot):
    job = a_job(slot)
    slot.begin(job)
    shown(slot, actual=NEW, version=110)
    slot.finish(job, accepted(version=105), NOW)
    assert (slot.asked, slot.peaks) == ({}, {})


def test_after_no_answer_nobody_knows_the_spec_and_the_note_may_be_there(slot):
    carry(slot, Outcome(error=UNREACHABLE))
    assert slot.spec("slam") is None
    assert slot.originals == BEFORE
    assert slot.holds(POLICY)
    assert slot.job is not None, "until it has rested"


def test_an_answer_ends_the_doubt(slot):
    carry(slot, Outcome(error=UNREACHABLE))
    carry(slot, accepted())
    assert slot.spec("slam") == NEW
    assert slot.attempts == 0


def test_a_refusal_leaves_what_was(slot):
    carry(slot, Outcome(error=refusal()), wanted=Cpu(100, 900))
    assert slot.spec("slam") == OLD
    assert slot.highest("slam") == 500
    assert not slot.holds(POLICY)


def test_a_note_that_was_written_before_a_refusal_is_known(slot):
    carry(slot, Outcome(version=101, noted=True, error=refusal()))
    assert slot.originals == BEFORE
    assert slot.holds(POLICY)


def test_a_refused_wish_is_forgotten_when_it_changes(slot):
    carry(slot, Outcome(error=refusal()))
    assert slot.refuses(POLICY, {"slam": NEW}, NOW, restore=False)
    assert not slot.refuses("lab/other", {"slam": NEW}, NOW, restore=False)
    assert not slot.refuses(POLICY, {"slam": NEW}, NOW, restore=True)
    assert not slot.refuses(POLICY, {"slam": OLD}, NOW, restore=False)
    assert not slot.refuses(POLICY, {"slam": NEW}, NOW, restore=False)


def test_a_refusal_holds_for_ever_longer(slot):
    for pause in (5.0, 10.0, 20.0):
        carry(slot, Outcome(error=refusal()))
        assert slot.refuses(POLICY, {"slam": NEW}, NOW + pause - 0.1, restore=False)
        assert not slot.refuses(POLICY, {"slam": NEW}, NOW + pause, restore=False)


def test_a_refused_wish_is_forgotten_when_the_pod_changes(slot):
    carry(slot, Outcome(error=refusal()))
    shown(slot, spec=OLD, generation=1, version=103)
    assert slot.refuses(POLICY, {"slam": NEW}, NOW, restore=False)
    shown(slot, spec=OLD, generation=2, version=104)
    assert not slot.refuses(POLICY, {"slam": NEW}, NOW, restore=False)


def test_what_is_saved_stays_saved_and_changes_hands(slot):
    carry(slot, accepted())
    assert slot.note("lab/other", {"slam"}) == {"slam": Original("lab/other", OLD)}


def test_what_is_not_in_the_pod_is_not_remembered(slot):
    assert slot.note(POLICY, {"slam", "gone"}) == BEFORE


def test_a_pod_that_has_ended_holds_nothing(slot):
    carry(slot, accepted())
    assert slot.holds(POLICY)
    slot.view = replace(slot.view, ended=True)
    assert not slot.holds(POLICY)


def test_a_container_that_never_ran_counts_by_its_spec():
    pod = a_pod("slam", {"slam": cpu("100m", "500m")})
    del pod["status"]["containerStatuses"]
    slot = PodSlot(view(pod))
    assert slot.highest("slam") == 500
    assert slot.highest("unknown") == 0
