"""Patches that fail or are refused: when they are asked for again, and when not."""

from __future__ import annotations

from itertools import pairwise

import pytest

from contextpolicy.actuators.resize.originals import Original
from contextpolicy.actuators.resize.pauses import FAILED, REFUSED
from contextpolicy.cluster.pods import Cpu
from contextpolicy.errors import ActuationError
from tests.actuators.resize.fake_cluster import UNREACHABLE, Unanswered, refusal
from tests.actuators.resize.rig import POLICY, Rig, two_pods
from tests.cluster.builders import a_pod, cpu


def times_of_calls(rig: Rig, seconds: float, step: float = 0.01) -> list[float]:
    """When the API was called."""
    times, seen = [], len(rig.cluster.calls)
    for count in range(round(seconds / step)):
        while rig.workers.jobs:
            rig.work()
        if len(rig.cluster.calls) > seen:
            times.append(count * step)
            seen = len(rig.cluster.calls)
        rig.wait(step)
    return times


@pytest.mark.parametrize(
    ("reason", "in_doubt"),
    [
        *((reason, False) for reason in ("Conflict", "TooManyRequests", "Unauthorized")),
        *((reason, True) for reason in ("Unreachable", "ServerError", "Unreadable")),
    ],
)
def test_transient_failures_are_retried_with_backoff(reason, in_doubt):
    """Where the answer was lost, what is tried again is the question what became of it."""
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, *[ActuationError(reason, "no", retriable=True, in_doubt=in_doubt)] * 8]
    rig.plan(slam=300)
    times = times_of_calls(rig, 25)
    gaps = [round(after - before, 1) for before, after in pairwise(times)]
    assert gaps == [FAILED.first, 0.2, 0.4, 0.8, 1.6, 3.2, FAILED.longest, FAILED.longest]
    assert rig.cluster.limit("slam") == 300
    assert rig.witness.problems == [(POLICY, "slam", reason)] * 8 + [(POLICY, "slam", "recovered")]


FAILURES = [
    refusal("Conflict", retriable=True),
    refusal("Invalid"),
    ActuationError("ServerError", "no", retriable=True, in_doubt=True),
    None,
]


@pytest.mark.parametrize("failure", FAILURES, ids=lambda failure: getattr(failure, "reason", "accepted"))
@pytest.mark.parametrize("leave", [lambda rig: rig.resizer.forget("uid-slam"), lambda rig: rig.resizer.abandon(POLICY)])
def test_an_answer_about_an_unclaimed_pod_is_ignored(leave, failure):
    """A problem reported then would never be reported as over."""
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, failure]
    rig.plan(slam=300)
    rig.workers.run()
    leave(rig)
    rig.wait(100)
    assert (rig.witness.problems, rig.witness.accepted, rig.workers.jobs) == ([], [], [])


def test_updates_and_plans_do_not_shorten_the_backoff():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal("Conflict", retriable=True)]
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=400)
    rig.cluster.report("uid-slam")
    rig.watch()
    assert rig.workers.jobs == []
    rig.wait(FAILED.first + 0.01)
    rig.work()
    assert rig.cluster.limit("slam") == 400


def test_lost_answers_are_recovered_and_keep_the_original():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [Unanswered(UNREACHABLE), None, Unanswered(UNREACHABLE)]
    rig.enforce(slam=300)
    assert rig.cluster.limit("slam") == 300
    assert rig.cluster.originals("uid-slam") == {"slam": Original(POLICY, Cpu(100, 500))}


@pytest.mark.parametrize("reason", ["Invalid", "Forbidden", "BadRequest", "Refused"])
def test_refusals_are_retried_slowly(reason):
    """A quota, a LimitRange or a role can change without any change of the pod, and nothing notifies us."""
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, *[refusal(reason)] * 6]
    rig.plan(slam=300)
    times = times_of_calls(rig, 400, step=1.0)
    gaps = [after - before for before, after in pairwise(times)]
    assert gaps == pytest.approx([REFUSED.first, 10, 20, 40, 80, REFUSED.longest], abs=1.0)
    assert rig.cluster.limit("slam") == 300
    assert rig.witness.problems == [(POLICY, "slam", reason)] * 6 + [(POLICY, "slam", "recovered")]


def test_updates_and_equal_plans_do_not_retry_a_refusal():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal("Forbidden")]
    rig.plan(slam=300)
    rig.work()
    rig.cluster.report("uid-slam")
    rig.watch()
    rig.plan(slam=300)
    assert rig.workers.jobs == []


def test_retry_after_is_honoured():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None]
    rig.cluster.faults.append(ActuationError("TooManyRequests", "busy", retriable=True, retry_after=7.0))
    rig.plan(slam=300)
    assert times_of_calls(rig, 10, step=1.0) == pytest.approx([0.0, 7.0], abs=1.0)


def test_refusal_is_retried_when_the_plan_changes():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal()]
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=400)
    rig.work()
    assert rig.cluster.limit("slam") == 400
    assert rig.witness.problems[-1] == (POLICY, "slam", "recovered")


def test_refusal_is_retried_when_the_pod_changes():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal()]
    rig.plan(slam=300)
    rig.work()
    rig.cluster.edit("uid-slam", "slam", cpu="600m")
    rig.settle()
    assert rig.cluster.limit("slam") == 300


def test_problem_clears_when_no_resize_is_needed_any_more():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal()]
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=500)
    assert rig.witness.problems[-1] == (POLICY, "slam", "recovered")


def test_refused_restore_is_retried_on_the_next_release():
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    rig.cluster.faults.append(refusal("Forbidden"))
    rig.release()
    rig.work()
    assert rig.released == []
    rig.watch()
    assert rig.workers.jobs == []
    rig.release()
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [POLICY])


def test_an_unexpected_failure_is_reported_and_retried():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [RuntimeError("token file is gone"), None, RuntimeError("still gone"), OSError("and now")]
    rig.enforce(slam=300)
    assert rig.cluster.limit("slam") == 300
    assert [(subject, reason) for _, subject, reason in rig.witness.problems] == [
        *(("its status", "Unexpected"), ("its status", "recovered")),
        *(("slam", "Unexpected"), ("slam", "Unexpected"), ("slam", "recovered")),
    ]


def test_missing_resize_subresource_is_reported_and_retried():
    """A cluster older than Kubernetes 1.33, or a proxy in between."""
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal("NotFound")]
    rig.plan(slam=300)
    rig.work()
    rig.work()
    assert rig.witness.problems == [(POLICY, "slam", "NotFound")]
    rig.wait(REFUSED.first + 0.1)
    rig.work()
    assert rig.cluster.limit("slam") == 300
    assert rig.witness.problems[-1] == (POLICY, "slam", "recovered")


def test_new_pod_of_the_same_name_gets_its_own_original():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, UNREACHABLE]
    rig.plan(slam=300)
    rig.work()
    rig.cluster.remove("uid-slam")
    rig.cluster.create(a_pod("slam", uid="uid-slam-2"))
    rig.wait(FAILED.first + 0.01)
    rig.work()
    assert [call for call, *_ in rig.cluster.calls] == ["store", "resize", "get", "store"], "its original is dropped"
    rig.settle()
    assert rig.cluster.limits("uid-slam-2") == {"slam": 300}
    assert rig.cluster.policies[POLICY].keys() == {"uid-slam-2"}


@pytest.mark.parametrize("act", [lambda rig: rig.plan(slam=400), lambda rig: rig.release()], ids=["plan", "restore"])
def test_patch_of_a_pod_never_reaches_the_next_one_of_its_name(act):
    """The watch has not shown yet that the pod was replaced, or never will."""
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    rig.cluster.remove("uid-slam")
    rig.cluster.create(a_pod("slam", {"slam": cpu("100m", "900m")}, uid="uid-slam-2"))
    act(rig)
    while rig.workers.jobs:
        rig.work()
    assert rig.cluster.limits("uid-slam-2") == {"slam": 900}
    assert rig.witness.problems == []
    rig.settle()
    assert rig.cluster.policies.get(POLICY, {}).keys() <= {"uid-slam-2"}, "the pod before is forgotten"


@pytest.mark.parametrize("effect", [True, False])
def test_lost_answer_is_resolved_by_reading_the_pod(effect):
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, Unanswered(UNREACHABLE) if effect else UNREACHABLE]
    rig.plan(slam=300)
    rig.work()
    rig.wait(FAILED.first + 0.01)
    rig.work()
    again = [] if effect else ["resize"]
    while rig.workers.jobs:
        rig.work()
    assert [call for call, *_ in rig.cluster.calls] == ["store", "resize", "get", *again]
    assert (rig.cluster.limit("slam"), rig.witness.accepted) == (300, [("lab/slam/slam", 300)])


def test_a_manual_change_after_a_restore_survives_a_lost_answer():
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    rig.cluster.faults += [None, Unanswered(UNREACHABLE)]
    rig.hold(POLICY)
    rig.settle()
    rig.cluster.edit("uid-slam", "slam", cpu="700m", by="kubectl-edit")
    rig.settle()
    rig.enforce(slam=300)
    rig.release()
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (700, [POLICY])


def test_deleted_pod_is_forgotten_without_a_problem():
    rig = two_pods()
    rig.plan(slam=300, speech=300)
    rig.cluster.remove("uid-slam")
    while rig.workers.jobs:
        rig.work()
    rig.wait(60.0)
    assert (rig.workers.jobs, rig.witness.problems) == ([], [])
    rig.release()
    rig.settle()
    assert rig.released == [POLICY]


def test_patch_that_outlives_its_pod_is_ignored():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.remove("uid-slam")
    rig.work()
    rig.release()
    assert rig.released == [POLICY]
