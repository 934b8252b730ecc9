"""From orders to patches: what is sent, when, and what is not."""

from __future__ import annotations

import json
from itertools import pairwise

import pytest

from contextpolicy.actuators.pauses import FAILED, REFUSED
from contextpolicy.actuators.pod_resize import RESTORE_PATIENCE, Order
from contextpolicy.actuators.pod_slot import SETTLING
from contextpolicy.cluster.pods import ORIGINALS, Cpu, Original
from contextpolicy.errors import ActuationError
from contextpolicy.planning.policy import Control
from tests.actuators.fake_cluster import UNREACHABLE, Unanswered, refusal
from tests.actuators.rig import MOMENT, POLICY, Rig
from tests.api.builders import NODE, a_pod, cpu

OTHER = "lab/other"


def two_pods(**kubelet: bool) -> Rig:
    return Rig(a_pod("slam"), a_pod("speech"), **kubelet)


def one_pod_for_two() -> Rig:
    return Rig(a_pod("slam", {"slam": cpu("100m", "500m"), "map": cpu("100m", "500m")}))


def limits(rig: Rig) -> tuple[int, int]:
    return rig.cluster.limit("slam"), rig.cluster.limit("speech")


# what is sent


def test_a_share_becomes_the_limit_and_the_request_stays():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    [(_, _, patch)] = [call for call in rig.cluster.calls if call[0] == "resize"]
    assert patch == {
        "spec": {
            "containers": [{"name": "slam", "resources": {"limits": {"cpu": "300m"}, "requests": {"cpu": "100m"}}}]
        }
    }


def test_nothing_is_sent_when_nothing_changes():
    rig = two_pods()
    rig.plan(slam=500, speech=500)
    rig.watch()
    rig.plan(slam=500, speech=500)
    assert rig.workers.jobs == []


def test_the_same_plan_again_sends_nothing_while_the_watch_is_late():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=300)
    assert rig.workers.jobs == []


def test_several_containers_of_a_pod_move_in_one_patch_and_sidecars_with_them():
    rig = Rig(a_pod("slam", {"slam": cpu("10m", "500m")}, sidecars={"map": cpu("10m", "400m")}))
    rig.plan(slam__slam=300, slam__map=200)
    rig.settle()
    assert rig.cluster.resizes() == [("slam", {"slam": "300m", "map": "200m"})]
    assert rig.cluster.limits("uid-slam") == {"slam": 300, "map": 200}


def test_a_container_that_the_order_does_not_name_is_left_alone():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300)
    rig.settle()
    assert rig.cluster.limits("uid-slam") == {"slam": 300, "map": 500}


@pytest.mark.parametrize(
    ("control", "resources"),
    [
        (Control.LIMIT, {"requests": {"cpu": "100m"}, "limits": {"cpu": "300m"}}),
        (Control.WEIGHT, {"requests": {"cpu": "300m"}, "limits": {"cpu": "800m"}}),
        (Control.BOTH, {"requests": {"cpu": "299m"}, "limits": {"cpu": "300m"}}),
    ],
)
def test_what_moves_is_the_policys_choice_and_all_of_it_comes_back(control, resources):
    rig = Rig(a_pod("slam", {"slam": cpu("100m", "500m", None)}))
    before = rig.cluster.pods["uid-slam"]["spec"]
    rig.plan(slam=300, control=control)
    rig.settle()
    assert rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"] == resources
    assert rig.witness.in_force == [("lab/slam/slam", 300)]
    rig.release()
    rig.settle()
    assert rig.cluster.pods["uid-slam"]["spec"] == before


def test_going_back_to_limits_brings_the_request_back():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300, control=Control.BOTH)
    rig.settle()
    rig.plan(slam=400)
    rig.settle()
    resources = rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]
    assert (resources["requests"]["cpu"], resources["limits"]["cpu"]) == ("100m", "400m")


@pytest.mark.parametrize("control", list(Control))
def test_a_guaranteed_pod_keeps_its_class_both_ways(control):
    rig = Rig(a_pod("slam", {"slam": cpu("500m", "500m", ("64Mi", "64Mi"))}, qos="Guaranteed"))
    for share in (800, 200):
        rig.plan(slam=share, control=control)
        rig.settle()
        resources = rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]
        assert resources["requests"]["cpu"] == resources["limits"]["cpu"] == f"{share}m"


# decreases before increases


def test_an_increase_waits_until_the_decrease_is_in_force():
    rig = two_pods()
    rig.plan(slam=800, speech=200)
    assert len(rig.workers.jobs) == 1
    rig.work()
    rig.watch()
    assert limits(rig) == (500, 200)
    assert rig.workers.jobs == [], "the API has it, the kubelet does not"
    rig.cluster.kubelet("uid-speech")
    rig.watch()
    assert rig.workers.jobs == [], "the kubelet has it and has not told"
    rig.cluster.report("uid-speech")
    rig.watch()
    rig.work()
    assert limits(rig) == (800, 200)


def test_a_report_about_an_older_spec_confirms_nothing():
    """Up and down again: in force may be what was asked in between, although spec and report look alike."""
    rig = two_pods()
    rig.plan(slam=300, speech=300)
    rig.settle()
    rig.plan(slam=300, speech=700)
    rig.work()
    rig.watch()
    rig.plan(slam=700, speech=300)
    rig.wait(SETTLING + 0.1)
    rig.work()
    rig.cluster.report("uid-speech")  # still of the first spec
    rig.watch()
    assert rig.workers.jobs == []
    rig.cluster.confirm("uid-speech")
    rig.watch()
    assert len(rig.workers.jobs) == 1


def test_what_the_driver_rounds_up_counts_as_in_force():
    rig = two_pods()
    rig.plan(slam=500, speech=333)
    rig.work()
    rig.cluster.kubelet("uid-speech")
    rig.cluster._specs["uid-speech"][0][1]["speech"] = 340
    rig.cluster.report("uid-speech")
    rig.watch()
    rig.plan(slam=660, speech=333)
    assert len(rig.workers.jobs) == 1


def test_an_increase_that_fits_need_not_wait():
    rig = two_pods()
    rig.plan(slam=800, speech=500, n=1300)
    assert len(rig.workers.jobs) == 1


def test_a_refused_increase_takes_no_room():
    """The kubelet never hears of it, so no news of the pod would ever free what it was to have."""
    rig = two_pods()
    rig.plan(slam=300, speech=300)
    rig.settle()
    rig.cluster.faults.append(refusal())
    rig.plan(slam=700, speech=300)
    rig.work()
    rig.plan(slam=300, speech=700)
    rig.work()
    assert limits(rig) == (300, 700)


def test_nothing_rises_beside_a_container_that_was_never_seen():
    """A new pod starts with the limit of its template; the plan counts on it already."""
    rig = Rig(a_pod("slam"))
    rig.plan(slam=800, speech=200)
    assert rig.workers.jobs == []
    rig.cluster.create(a_pod("speech"))
    rig.watch()
    rig.work()
    assert limits(rig) == (500, 200)
    rig.settle()
    assert limits(rig) == (800, 200)


def test_a_pod_keeps_its_share_until_its_containers_have_ended():
    rig = two_pods()
    rig.plan(slam=600, speech=400)
    rig.settle()
    rig.cluster.terminate("uid-speech")
    rig.watch()
    rig.plan(slam=1000)
    assert rig.workers.jobs == []
    rig.remove("uid-speech")
    rig.work()
    assert rig.cluster.limit("slam") == 1000


def test_weights_need_no_order():
    rig = two_pods()
    rig.plan(slam=800, speech=200, control=Control.WEIGHT)
    assert len(rig.workers.jobs) == 2


# the latest plan wins


def test_plans_during_a_patch_become_one_patch_the_newest():
    rig = Rig(a_pod("slam"))
    for share in (300, 350, 400, 450):
        rig.plan(slam=share)
    assert len(rig.workers.jobs) == 1
    rig.work()
    rig.cluster.confirm()
    rig.watch()
    assert len(rig.workers.jobs) == 1
    rig.work()
    assert [limits["slam"] for _, limits in rig.cluster.resizes()] == ["300m", "450m"]
    assert rig.workers.jobs == []


def test_a_newer_plan_does_not_queue_up_behind_the_kubelets_last_resize():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    for share in (350, 400, 450):
        rig.plan(slam=share)
        assert rig.workers.jobs == []
    rig.cluster.confirm()
    rig.watch()
    rig.work()
    assert [limits["slam"] for _, limits in rig.cluster.resizes()] == ["300m", "450m"]


def test_a_kubelet_that_says_nothing_holds_the_newest_plan_up_for_a_moment_only():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=450)
    rig.wait(SETTLING + 0.1)
    rig.work()
    assert [limits["slam"] for _, limits in rig.cluster.resizes()] == ["300m", "450m"]


def test_a_plan_made_while_a_patch_was_refused_is_sent_at_once():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.plan(slam=400)
    rig.cluster.faults.append(refusal())
    rig.work()
    rig.work()
    assert rig.cluster.limit("slam") == 400


# the note of what was there


def test_the_originals_are_written_once_and_before_the_first_resize():
    rig = Rig(a_pod("slam"))
    for share in (300, 400, 450):
        rig.plan(slam=share)
        rig.settle()
    assert [call for call, *_ in rig.cluster.calls] == ["annotate", "resize", "resize", "resize"]
    written = json.loads(rig.cluster.calls[0][2][ORIGINALS])
    assert written == {"slam": {"policy": POLICY, "request": "100m", "limit": "500m"}}


def test_a_release_puts_all_back_and_then_takes_the_note_away():
    rig = two_pods()
    rig.plan(slam=300, speech=700)
    rig.settle()
    rig.cluster.calls.clear()
    rig.release()
    assert rig.released == []
    rig.settle()
    resized, noted = ("resize", "speech"), ("annotate", "speech")
    assert [call[:2] for call in rig.cluster.calls] == [resized, noted, ("resize", "slam"), ("annotate", "slam")]
    assert limits(rig) == (500, 500)
    assert rig.cluster.originals("uid-slam") == rig.cluster.originals("uid-speech") == {}
    assert rig.released == [POLICY]


def test_a_release_with_nothing_to_do_is_done_at_once():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=500)
    rig.release()
    assert (rig.released, rig.cluster.calls) == ([POLICY], [])


def test_a_release_waits_for_the_first_patch_that_is_under_way():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.release()
    assert rig.released == []
    rig.work()
    assert rig.cluster.limit("slam") == 300
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.cluster.originals("uid-slam"), rig.released) == (500, {}, [POLICY])


def test_a_release_after_a_first_patch_without_an_answer_restores():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.cluster.faults += [None, Unanswered(UNREACHABLE)]
    rig.work()
    rig.release()
    assert rig.released == []
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.cluster.originals("uid-slam"), rig.released) == (500, {}, [POLICY])


def test_a_release_takes_away_the_note_of_a_resize_that_was_refused():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.cluster.faults += [None, refusal()]
    rig.work()
    rig.release()
    rig.settle()
    assert (rig.cluster.originals("uid-slam"), rig.released) == ({}, [POLICY])


def test_a_release_does_not_wait_for_pods_that_vanish_or_end():
    rig = two_pods()
    rig.plan(slam=300, speech=300)
    rig.settle()
    rig.release()
    rig.cluster.pods["uid-slam"]["status"]["phase"] = "Failed"  # evicted pods stay as objects
    rig.cluster._commit("uid-slam")
    rig.watch("uid-slam")
    rig.remove("uid-speech")
    assert rig.released == [POLICY]


def test_a_container_that_is_claimed_no_more_is_put_back():
    rig = two_pods()
    rig.plan(slam=300, speech=700)
    rig.settle()
    rig.plan(slam=300)
    rig.settle()
    assert limits(rig) == (300, 500)
    assert rig.cluster.originals("uid-speech") == {}


def test_a_plan_that_is_ordered_late_does_not_hold_what_is_claimed_no_more():
    """It still has a share for a container that the policy has lost, and for one whose pod is gone."""
    rig = two_pods()
    rig.plan(slam=300, speech=300)
    rig.settle()
    shares = {"lab/slam/slam": 400, "lab/speech/speech": 300, "lab/gone/gone": 100}
    rig.resizer.apply(Order(POLICY, frozenset({"lab/slam/slam"}), shares, {NODE: 1000}))
    rig.settle()
    assert limits(rig) == (400, 500)
    assert rig.cluster.originals("uid-speech") == {}


def test_a_claimed_container_without_a_share_keeps_what_it_has():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.settle()
    rig.order(POLICY, {})
    rig.order(POLICY, {"lab/slam/slam": 300})
    rig.settle()
    assert rig.cluster.limit("slam") == 300


def test_a_policy_that_takes_a_container_over_restores_what_was_there_before_the_first():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.settle()
    rig.kill()  # and the first policy was removed by force meanwhile
    rig.plan(OTHER, slam=400)
    rig.settle()
    assert rig.cluster.originals("uid-slam") == {"slam": Original(OTHER, Cpu(100, 500))}
    rig.release(OTHER)
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [OTHER])


def test_a_late_view_does_not_make_a_restored_container_look_annotated():
    """Claimed again while the watch still shows the old note: it must be written anew."""
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.settle()
    rig.release()
    rig.work()
    assert len(rig.cluster.feeds["uid-slam"]) == 2
    rig.watch_one("uid-slam")  # resized back, the note still there
    rig.plan(slam=400)
    rig.watch()
    rig.settle()
    assert rig.cluster.originals("uid-slam") == {"slam": Original(POLICY, Cpu(100, 500))}


def test_a_damaged_note_does_not_keep_the_pod_from_being_resized():
    rig = Rig(a_pod("slam", annotations={ORIGINALS: "{slam"}))
    rig.plan(slam=300)
    rig.settle()
    assert rig.cluster.limit("slam") == 300


# what is put back: decreases before increases, but not for ever


def about_to_release() -> Rig:
    """slam had 300m and is to rise to 500m, speech had 700m and is to fall to 500m."""
    rig = two_pods()
    rig.plan(slam=300, speech=700)
    rig.settle()
    return rig


def test_what_is_put_back_rises_when_what_falls_is_in_force():
    rig = about_to_release()
    rig.release()
    rig.work()
    rig.watch()
    assert (limits(rig), rig.workers.jobs, rig.released) == ((300, 500), [], []), "the API has it, the kubelet does not"
    rig.cluster.confirm("uid-speech")
    rig.watch()
    rig.work()
    assert (limits(rig), rig.released) == ((500, 500), [POLICY])


def test_originals_that_sum_above_the_capacity_are_put_back_all_the_same():
    rig = Rig(a_pod("slam", {"slam": cpu("10m", "1500m")}), a_pod("speech", {"speech": cpu("10m", "900m")}))
    rig.plan(slam=20, speech=980)
    rig.settle()
    rig.release()
    rig.settle()
    assert (limits(rig), rig.released) == ((1500, 900), [POLICY])


@pytest.mark.parametrize("fault", [None, refusal(), UNREACHABLE], ids=["kubelet gone", "refused", "unreachable"])
def test_what_does_not_fall_keeps_nothing_from_rising_for_long(fault):
    rig = about_to_release()
    rig.cluster.faults += [fault] if fault is None else [fault] * 20
    rig.release()
    rig.work()
    rig.wait(RESTORE_PATIENCE - 0.1)
    assert rig.cluster.limit("slam") == 300
    rig.cluster.faults.clear()
    rig.wait(0.2)
    while rig.workers.jobs:
        rig.work()
    assert rig.cluster.limit("slam") == 500


def test_a_pod_that_goes_keeps_nothing_from_rising():
    rig = about_to_release()
    rig.release()
    rig.cluster.terminate("uid-speech")
    rig.watch()
    assert rig.cluster.limit("slam") == 300, "its containers still run"
    rig.remove("uid-speech")
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [POLICY])


def test_containers_of_one_pod_are_put_back_in_order_too():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300, slam__map=700)
    rig.settle()
    rig.release()
    rig.work()
    assert rig.cluster.limits("uid-slam") == {"slam": 300, "map": 500}
    assert rig.cluster.originals("uid-slam").keys() == {"slam"}
    rig.settle()
    assert (rig.cluster.limits("uid-slam"), rig.released) == ({"slam": 500, "map": 500}, [POLICY])


def test_a_decrease_on_another_node_is_not_waited_for():
    far = a_pod("speech")
    far["spec"]["nodeName"] = "robot-2"
    rig = Rig(a_pod("slam"), far)
    shares = {"lab/slam/slam": 300, "lab/speech/speech": 700}
    rig.resizer.apply(Order(POLICY, frozenset(shares), shares, {NODE: 1000, "robot-2": 1000}))
    rig.settle()
    rig.release()
    assert len(rig.workers.jobs) == 2


def test_a_second_restore_is_in_order_too():
    rig = about_to_release()
    for _ in range(2):
        rig.plan(slam=300, speech=700)
        rig.settle()
        rig.plan()  # claims nothing any more
        rig.work()
        rig.watch()
        assert limits(rig) == (300, 500)
        rig.settle()
        assert limits(rig) == (500, 500)


def test_a_restore_after_a_restart_is_in_order():
    rig = about_to_release()
    rig.kill()
    rig.release()
    rig.work()
    assert (limits(rig), rig.workers.jobs) == ((300, 500), [])
    rig.settle()
    assert (limits(rig), rig.released) == ((500, 500), [POLICY])


# two policies in one pod


def test_policies_that_share_a_pod_do_not_wait_for_news_of_each_others_patch():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300)
    rig.plan(OTHER, slam__map=300)
    rig.cluster.faults.append(refusal())
    rig.work()
    rig.work()
    assert rig.cluster.limits("uid-slam") == {"slam": 500, "map": 300}


def test_each_policy_restores_its_own_containers():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300)
    rig.plan(OTHER, slam__map=300)
    rig.settle()
    rig.release()
    rig.settle()
    assert rig.cluster.limits("uid-slam") == {"slam": 500, "map": 300}
    assert rig.cluster.originals("uid-slam").keys() == {"map"}


def test_a_refused_restore_is_not_repeated_when_another_policy_plans():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300)
    rig.plan(OTHER, slam__map=300)
    rig.settle()
    rig.cluster.faults.append(refusal())
    rig.plan()  # claims nothing any more
    rig.work()
    for _ in range(3):
        rig.plan(OTHER, slam__map=300)
    assert rig.workers.jobs == []


# failures


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


@pytest.mark.parametrize("reason", ["Unreachable", "Conflict", "TooManyRequests", "ServerError", "Unauthorized"])
def test_a_failure_that_may_pass_is_tried_again_ever_more_slowly(reason):
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [refusal(reason, retriable=True)] * 8
    rig.plan(slam=300)
    times = times_of_calls(rig, 25)
    gaps = [round(after - before, 1) for before, after in pairwise(times)]
    assert gaps == [FAILED.first, 0.2, 0.4, 0.8, 1.6, 3.2, FAILED.longest, FAILED.longest]
    assert rig.cluster.limit("slam") == 300
    assert rig.witness.problems == [(POLICY, "slam", reason)] * 8 + [(POLICY, "slam", "recovered")]


def test_neither_news_nor_plans_shorten_the_pause():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [UNREACHABLE]
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=400)
    rig.cluster.report("uid-slam")
    rig.watch()
    assert rig.workers.jobs == []
    rig.wait(FAILED.first + MOMENT)
    rig.work()
    assert rig.cluster.limit("slam") == 400


def test_an_answer_that_is_lost_is_asked_for_again_and_the_note_is_not_spoilt():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [Unanswered(UNREACHABLE), None, Unanswered(UNREACHABLE)]
    rig.plan(slam=300)
    rig.settle()
    assert rig.cluster.limit("slam") == 300
    assert rig.cluster.originals("uid-slam") == {"slam": Original(POLICY, Cpu(100, 500))}


@pytest.mark.parametrize("reason", ["Invalid", "Forbidden", "BadRequest", "Refused"])
def test_a_refusal_is_tried_again_at_a_slow_pace(reason):
    """A quota, a LimitRange or a role can change with nothing on the pod changing; nobody tells us."""
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, *[refusal(reason)] * 6]
    rig.plan(slam=300)
    times = times_of_calls(rig, 400, step=1.0)
    gaps = [after - before for before, after in pairwise(times)]
    assert gaps == pytest.approx([REFUSED.first, 10, 20, 40, 80, REFUSED.longest], abs=1.0)
    assert rig.cluster.limit("slam") == 300
    assert rig.witness.problems == [(POLICY, "slam", reason)] * 6 + [(POLICY, "slam", "recovered")]


def test_neither_news_nor_the_same_plan_repeat_a_refusal():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal("Forbidden")]
    rig.plan(slam=300)
    rig.work()
    rig.cluster.report("uid-slam")
    rig.watch()
    rig.plan(slam=300)
    assert rig.workers.jobs == []


def test_the_api_says_when_it_wants_to_be_asked_again():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults.append(ActuationError("TooManyRequests", "busy", retriable=True, retry_after=7.0))
    rig.plan(slam=300)
    assert times_of_calls(rig, 10, step=1.0) == [0.0, 7.0]


def test_a_refusal_is_tried_again_when_the_wish_changes():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal()]
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=400)
    rig.work()
    assert rig.cluster.limit("slam") == 400
    assert rig.witness.problems[-1] == (POLICY, "slam", "recovered")


def test_a_refusal_is_tried_again_when_the_pod_changes():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal()]
    rig.plan(slam=300)
    rig.work()
    rig.cluster.edit("uid-slam", "slam", cpu="600m")
    rig.settle()
    assert rig.cluster.limit("slam") == 300


def test_a_refused_wish_that_is_given_up_is_no_problem_any_more():
    rig = Rig(a_pod("slam"))
    rig.cluster.faults += [None, refusal()]
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=500)
    assert rig.witness.problems[-1] == (POLICY, "slam", "recovered")


def test_a_refused_restore_is_tried_again_when_somebody_asks_again():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.settle()
    rig.cluster.faults.append(refusal("Forbidden"))
    rig.release()
    rig.work()
    assert rig.released == []
    rig.watch()
    assert rig.workers.jobs == []
    rig.release()
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [POLICY])


def test_a_pod_that_is_not_found_is_forgotten_without_a_word():
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


def test_a_patch_that_ends_after_its_pod_changes_nothing():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.remove("uid-slam")
    rig.work()
    rig.release()
    assert rig.released == [POLICY]


# what the watch shows


def test_a_view_from_before_the_last_patch_sends_nothing():
    rig = Rig(a_pod("slam"))
    rig.cluster.report("uid-slam")
    rig.plan(slam=300)
    rig.work()
    rig.watch_one("uid-slam")  # the report from before
    rig.watch_one("uid-slam")  # the note, not yet the resize
    assert rig.workers.jobs == []


def test_an_external_change_of_the_limit_is_put_right():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.settle()
    rig.cluster.edit("uid-slam", "slam", cpu="900m")
    rig.watch()
    rig.work()
    assert rig.cluster.limit("slam") == 300


def test_a_new_pod_gets_its_share():
    rig = two_pods()
    rig.plan(slam=300, speech=700)
    rig.settle()
    rig.remove("uid-slam")
    rig.cluster.create(a_pod("slam", uid="uid-slam-2"))
    rig.settle()
    assert rig.cluster.limits("uid-slam-2") == {"slam": 300}


def test_accepted_and_in_force_are_told():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    assert (rig.witness.accepted, rig.witness.in_force) == ([("lab/slam/slam", 300)], [])
    rig.cluster.confirm()
    rig.watch()
    rig.cluster.report("uid-slam")
    rig.watch()
    assert rig.witness.in_force == [("lab/slam/slam", 300)]


# restarts


def test_a_new_operator_knows_the_originals_and_restores_them():
    rig = two_pods()
    rig.plan(slam=800, speech=200)
    rig.settle()
    rig.kill()
    rig.plan(slam=800, speech=200)
    assert rig.workers.jobs == []
    rig.release()
    rig.settle()
    assert limits(rig) == (500, 500)
    assert rig.released == [POLICY]


def test_a_new_operator_moves_nothing_before_a_policy_speaks():
    rig = two_pods()
    rig.plan(slam=800, speech=200)
    rig.settle()
    rig.kill()
    rig.wait(60.0)
    assert rig.workers.jobs == []


@pytest.mark.parametrize("observed_generation", [True, False])
def test_kubelets_that_report_no_observed_generation_are_believed_by_their_resources(observed_generation):
    rig = two_pods(observed_generation=observed_generation)
    rig.cluster.confirm()
    rig.watch()
    rig.plan(slam=800, speech=200)
    rig.work()
    rig.watch()
    assert rig.workers.jobs == []
    rig.settle()
    assert limits(rig) == (800, 200)
