"""Another writer resizes the same containers: reported, put back, and never a fight."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.resize import guard
from contextpolicy.actuators.resize.conflict import REMEMBERED, STRIKES, YIELDED
from contextpolicy.actuators.resize.originals import Original
from contextpolicy.actuators.resize.pauses import CONFLICTING
from contextpolicy.actuators.resize.pod_state import PodState
from contextpolicy.actuators.resize.targets import Target
from contextpolicy.actuators.resize.tracked_pod import TrackedPod
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.spec import Control
from tests.actuators.resize.contesting import OURS
from tests.actuators.resize.fake_cluster import UNREACHABLE, Unanswered
from tests.actuators.resize.rig import MOMENT, POLICY, Rig
from tests.cluster.builders import a_pod, cpu

SLAM = "lab/slam/slam"


def governed_rig(share: int = 300) -> Rig:
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=share)
    rig.cluster.calls.clear()
    return rig


def take(rig: Rig, limit: str = "700m", **more: str) -> None:
    """Another writer resizes, and the watch reports it."""
    rig.cluster.edit("uid-slam", "slam", cpu=limit, **more)
    rig.watch()


def test_a_foreign_limit_is_reported_and_put_back_at_once():
    rig = governed_rig()
    take(rig)
    rig.work()
    assert rig.cluster.limit("slam") == 300
    assert rig.witness.conflicts == [(SLAM, ("vpa-updater", 300, 700))]
    rig.settle()
    rig.wait(REMEMBERED)
    assert rig.witness.conflicts[1:] == [(SLAM, "over")]


def test_a_foreign_request_is_reported_and_put_back():
    rig = governed_rig()
    take(rig, "300m", request="250m", by="kubectl-edit")
    rig.settle()
    assert rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]["requests"]["cpu"] == "100m"
    assert rig.witness.conflicts[:1] == [(SLAM, ("kubectl-edit", 300, 300))]


def test_a_persistent_writer_wins_and_is_reported():
    rig = governed_rig()
    for _ in range(40 * 60):
        if rig.cluster.limit("slam") == 300:
            rig.cluster.edit("uid-slam", "slam", cpu="700m")
        rig.cluster.confirm()
        rig.watch()
        while rig.workers.jobs:
            rig.work()
        rig.wait(0.5)
    assert rig.cluster.limit("slam") == 700
    assert len(rig.cluster.resizes()) == STRIKES + 1, "once more after ten minutes"
    assert rig.witness.conflicts[-1] == (SLAM, ("vpa-updater", 300, 700))
    assert "over" not in [what for _, what in rig.witness.conflicts]


def test_new_plans_do_not_reopen_a_yielded_conflict():
    rig = governed_rig()
    for _ in range(STRIKES + 1):
        take(rig)
        rig.wait(CONFLICTING.longest + 0.1)
        while rig.workers.jobs:
            rig.work()
        rig.watch()
    for share in (400, 200, 600):
        rig.plan(slam=share)
        rig.wait(10)
        assert rig.workers.jobs == []
    assert rig.cluster.limit("slam") == 700
    rig.wait(YIELDED)
    rig.work()
    assert rig.cluster.limit("slam") == 600


def test_foreign_writer_that_reverts_and_returns_counts_twice():
    rig = governed_rig()
    take(rig)
    rig.work()
    rig.watch()
    for limit in ("700m", "300m", "700m"):
        take(rig, limit)
    rig.wait(CONFLICTING.first + 0.1)
    assert rig.workers.jobs == []
    rig.wait(2 * CONFLICTING.first)
    assert len(rig.workers.jobs) == 1
    assert len(rig.witness.conflicts) == 3


def test_new_plans_do_not_shorten_a_pause():
    rig = governed_rig()
    for _ in range(2):
        take(rig)
        while rig.workers.jobs:
            rig.work()
    for share in (400, 200, 300, 600):
        rig.plan(slam=share)
        assert rig.workers.jobs == []
    rig.wait(CONFLICTING.first + 0.1)
    rig.work()
    assert rig.cluster.limit("slam") == 600


def test_foreign_limit_reduces_the_headroom_of_the_node():
    rig = Rig(a_pod("slam"), a_pod("speech"))
    rig.enforce(slam=800, speech=200)
    for _ in range(2):
        rig.cluster.edit("uid-speech", "speech", cpu="600m")
        rig.cluster.confirm()
        rig.watch()
        while rig.workers.jobs:
            rig.work()
    rig.plan(slam=900, speech=100)
    assert rig.workers.jobs == [], "slam must not rise beside 600m"
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.cluster.limit("speech")) == (900, 100)


def test_foreign_limit_reverted_before_the_kubelet_reports_it_still_counts():
    rig = Rig(a_pod("slam"), a_pod("speech"))
    rig.enforce(slam=300, speech=200)
    take(rig, "700m")
    take(rig, "300m")  # its writer takes it back; the kubelet may have seen it
    rig.work()
    rig.watch()
    rig.plan(slam=300, speech=600)
    assert rig.workers.jobs == []
    rig.settle()
    assert rig.cluster.limit("speech") == 600


def test_foreign_limit_is_never_restored():
    rig = governed_rig()
    for _ in range(3):
        take(rig)
        while rig.workers.jobs:
            rig.work()
    rig.release()
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.cluster.originals("uid-slam"), rig.released) == (500, {}, [POLICY])


def test_foreign_write_is_reverted_where_the_share_equals_the_original():
    """Its share is what it has, so nothing was ever noted in the pod."""
    rig = governed_rig(share=500)
    take(rig, request="200m")
    rig.settle()
    assert rig.witness.conflicts[:1] == [(SLAM, ("vpa-updater", 500, 700))]
    assert rig.cluster.limit("slam") == 500
    assert rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]["requests"]["cpu"] == "100m"
    assert rig.cluster.originals("uid-slam") == {"slam": Original(POLICY, Cpu(100, 500))}


def test_container_that_was_never_resized_is_not_owned():
    pod = view(a_pod("slam"))
    tracked, [container] = TrackedPod(PodState(pod)), pod.containers
    target = Target(SLAM, tracked, container, OURS, tracked.state.spec(container.name), container.spec, original=None)
    assert (guard.look(POLICY, target, 0.0), tracked.owned) == (None, {})


def test_limit_set_before_the_policy_is_not_a_conflict():
    rig = Rig(a_pod("slam"))
    take(rig)
    rig.enforce(slam=300)
    assert rig.witness.conflicts == []
    rig.release()
    rig.settle()
    assert rig.cluster.limit("slam") == 700


def test_limit_set_after_release_is_not_a_conflict():
    for share in (300, 500):
        rig = governed_rig(share)
        rig.release()
        rig.settle()
        take(rig)
        rig.enforce(slam=300)
        assert rig.witness.conflicts == []


def test_foreign_limit_equal_to_the_new_plan_stays():
    rig = governed_rig()
    rig.cluster.edit("uid-slam", "slam", cpu="700m")
    rig.plan(slam=700)
    rig.watch()
    rig.settle()
    assert rig.cluster.limit("slam") == 700


def test_lost_answer_is_not_a_conflict():
    rig = governed_rig()
    rig.cluster.faults.append(Unanswered(UNREACHABLE))
    rig.plan(slam=400)
    rig.work()
    rig.watch()
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.witness.conflicts) == (400, [])


@pytest.mark.parametrize("control", list(Control))
def test_no_conflict_is_reported_without_foreign_writes(control):
    rig = Rig(a_pod("slam", {"slam": cpu("100m", "500m", None), "map": cpu("100m", "500m", None)}))
    for slam in (300, 400, 200):
        rig.enforce(slam__slam=slam, slam__map=600 - slam, control=control)
    rig.kill()
    rig.enforce(slam__slam=250, slam__map=250, control=control)
    assert rig.witness.conflicts == []


def test_external_limits_set_without_an_operator_are_reported():
    rig = governed_rig()
    rig.cluster.edit("uid-slam", "slam", cpu="700m", by="kubectl-edit")
    rig.kill()
    rig.plan(slam=300)
    assert rig.witness.conflicts == [(SLAM, ("kubectl-edit", 500, 700))]
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.cluster.originals("uid-slam")["slam"].cpu.limit) == (300, 500)


def test_a_foreign_request_while_no_operator_ran_is_reported():
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300, control=Control.WEIGHT)
    rig.cluster.edit("uid-slam", "slam", by="kubectl-edit", cpu="800m", request="200m")
    rig.cluster.edit("uid-slam", "slam", cpu="800m")
    rig.kill()
    rig.plan(slam=300, control=Control.WEIGHT)
    assert rig.witness.conflicts != []


def test_own_patch_watched_before_its_answer_is_not_a_conflict():
    rig = governed_rig()
    rig.plan(slam=400)
    rig.workers.run()
    rig.resizer.observe(view(rig.cluster.feeds["uid-slam"].popleft()))
    rig.enforce(slam=450)
    assert (rig.cluster.limit("slam"), rig.witness.conflicts) == (450, [])


def test_stored_original_without_a_resize_is_not_a_conflict():
    """The operator before died between the two."""
    rig = Rig(a_pod("slam"))
    rig.cluster.policies[POLICY] = {
        "uid-slam": {"pod": "slam", "containers": {"slam": {"request": "100m", "limit": "500m"}}}
    }
    rig.kill()
    rig.plan(slam=300)
    rig.wait(MOMENT)
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.witness.conflicts) == (300, [])


def test_conflict_ends_once_when_the_other_writer_stops():
    rig = governed_rig()
    for _ in range(3):
        take(rig)
        rig.settle()
        rig.wait(REMEMBERED / 2)
    assert (SLAM, "over") not in rig.witness.conflicts
    rig.wait(REMEMBERED)
    assert rig.witness.conflicts[-1] == (SLAM, "over")
    rig.wait(10 * REMEMBERED)
    assert [told for _, told in rig.witness.conflicts].count("over") == 1
