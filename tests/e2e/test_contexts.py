"""The main job: what the sensors say decides what the kernel enforces."""

import contextlib
import itertools
import threading
import time

import pytest

from tests.e2e.cluster import apply, delete, until
from tests.e2e.robot import policy, task, together


def test_context_moves_cpu_between_running_pods(governed):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    until("the status shows it", lambda: governed.status()["activeContexts"] == ["moving"])
    governed.drive(0.0)
    governed.expect(slam=500, speech=500)
    assert [governed.restarts(task) for task in ("slam", "speech")] == [0, 0]


@contextlib.contextmanager
def limits_over_time(robot):
    """The limits (of slam, of speech) that the kernel enforced together, looked at every millisecond by a thread."""
    cgroups, seen, over = {task: robot.container(task) for task in ("slam", "speech")}, set(), threading.Event()

    def look():
        if now := together(cgroups):
            seen.add((now["slam"], now["speech"]))

    def look_on():
        while not over.wait(0.001):
            look()

    look()
    thread = threading.Thread(target=look_on)
    thread.start()
    try:
        yield seen
    finally:
        over.set()
        thread.join()
        look()


def test_limits_never_sum_above_capacity(governed):
    """Decreases are in force before increases are asked for, through 20 changes."""
    governed.policy(enforcement={"transition": "Strict"})
    with limits_over_time(governed) as seen:
        for speed in itertools.islice(itertools.cycle([0.3, 0.0]), 20):
            governed.drive(speed)
            time.sleep(0.3)
        governed.drive(0.3)
        governed.expect(slam=990, speech=10)
    assert max(map(sum, seen)) <= 1000
    assert {(500, 500), (990, 10)} <= seen


@pytest.mark.parametrize("end", ["deleted", "Paused", "DryRun"])
def test_restoring_never_exceeds_capacity_and_enforcing_resumes(governed, end):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    with limits_over_time(governed) as seen:
        if end == "deleted":
            delete("ctxp", "robot", governed.namespace)
        else:
            governed.policy(mode=end)
        governed.expect(slam=500, speech=500)
    assert max(map(sum, seen)) <= 1000
    assert {(500, 500), (990, 10)} <= seen
    governed.policy()
    governed.expect(slam=990, speech=10)


def test_status_reports_weights_shares_and_conditions(governed):
    governed.drive(0.3)
    until("the status has the context", lambda: governed.status().get("contexts") == "moving")
    status = governed.status()
    shares = {entry["name"]: (entry["share"], entry["suspended"]) for entry in status["tasks"]}
    assert shares == {"slam": ("990m", False), "speech": ("10m", True)}
    assert status["boundTasks"] == "2/2"
    assert status["observedGeneration"] == 1
    assert {c["type"]: c["status"] for c in status["conditions"]}["Ready"] == "True"


def test_restarted_container_keeps_its_share(governed):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    governed.kill("slam")
    until("the container runs again", lambda: governed.restarts("slam") == 1)
    governed.expect(slam=990, speech=10)


def test_invalid_edit_leaves_the_last_good_plan(governed):
    """CEL is compiled by the operator: the API server can't refuse an expression."""
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    governed.policy(contexts=[{"name": "moving", "when": "imu.speed >", "tasks": {"speech": {"suspend": True}}}])
    until("the status refuses the edit", lambda: governed.condition("Accepted")[0] == "False")
    assert "spec.contexts[0].when: invalid value 'imu.speed >'" in governed.condition("Accepted")[1]
    governed.drive(0.0)
    governed.expect(slam=500, speech=500)


def test_second_policy_on_a_container_yields(governed):
    second = policy(governed.namespace, "second", tasks=[task("slam"), task("speech", max="10m")])
    apply(second)
    until("the younger policy is reported", lambda: governed.condition("Accepted", "second")[0] == "False")
    message = governed.condition("Accepted", "second")[1]
    assert f"{governed.namespace}/slam/slam belongs to task slam of {governed.namespace}/robot" in message
    governed.expect(slam=500, speech=500)
    assert governed.condition("Accepted")[0] == "True"


def test_an_edit_keeps_the_context_that_holds(governed):
    contexts = [{**policy("")["spec"]["contexts"][0], "exitAfter": "1h"}]
    governed.policy(contexts=contexts)
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    governed.drive(0.0)
    governed.policy(contexts=contexts, reserve="1100m")
    governed.expect(slam=890, speech=10)


def test_condition_is_decided_without_an_unheard_stream(governed):
    streams = [
        *policy(governed.namespace)["spec"]["streams"],
        {"name": "button", "key": f"{governed.namespace}/button"},
    ]
    alarm = {"name": "alarm", "when": "imu.speed > 0.05 || button.pressed", "tasks": {"speech": {"suspend": True}}}
    governed.policy(streams=streams, contexts=[alarm])
    governed.drive(0.0)
    until(
        "the status shows what is waited for",
        lambda: "context alarm has been waiting since" in str(governed.status()["streams"]),
    )
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)


@pytest.mark.parametrize("payload", [b"[" * 100_000, b'{"speed": "fast"}'])
def test_an_invalid_sample_changes_nothing(governed, payload):
    governed.sensors.read(f"{governed.namespace}/imu-noise", payload)
    streams = [
        {"name": "imu", "key": f"{governed.namespace}/imu", "staleAfter": "1s"},
        {"name": "noise", "key": f"{governed.namespace}/imu-noise"},
    ]
    contexts = [
        *policy("")["spec"]["contexts"],
        {"name": "loud", "when": "noise.speed > 1.0", "tasks": {"slam": {"suspend": True}}},
    ]
    governed.policy(streams=streams, contexts=contexts)
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    governed.sensors.read(f"{governed.namespace}/imu-noise", None)
    until("the status shows it", lambda: governed.status()["activeContexts"] == ["moving"])


def test_suspending_every_task_gives_each_the_least(governed):
    every = {"slam": {"suspend": True}, "speech": {"weight": 0}}
    governed.policy(contexts=[{"name": "moving", "when": "imu.speed > 0.05", "tasks": every}])
    governed.drive(0.3)
    governed.expect(slam=10, speech=10)
    until("the status says so", lambda: governed.status()["nodes"][0]["dividedBy"] == "Nothing")
    governed.drive(0.0)
    governed.expect(slam=500, speech=500)


def test_while_nothing_is_active_priorities_divide_the_node(governed):
    active = [{"when": "imu.speed > 0.05"}]
    governed.policy(tasks=[task("slam", priority=3, activity=active), task("speech", activity=active)], contexts=[])
    governed.expect(slam=750, speech=250)
    until("the status says so", lambda: governed.status()["nodes"][0]["dividedBy"] == "Priority")
    assert [entry["suspended"] for entry in governed.status()["tasks"]] == [False, False]


def test_a_protected_task_keeps_its_min_whatever_the_context(governed):
    governed.policy(tasks=[task("slam"), task("speech", protected=True, min="300m", priority=0.1)])
    governed.drive(0.3)
    governed.expect(slam=700, speech=300)


def test_weights_in_the_status_follow_the_sensors_although_no_share_moves(governed):
    fixed = {"min": "500m", "max": "500m"}
    governed.policy(tasks=[task("slam", activity=[{"scoreFrom": "imu.speed"}], **fixed), task("speech")], contexts=[])
    for speed in (0.25, 0.75):
        governed.drive(speed)
        until("the weight is the speed", lambda speed=speed: governed.status()["tasks"][0]["weight"] == speed)
    governed.expect(slam=500, speech=500)


def test_a_compound_waits_for_a_subtask_without_a_pod(governed):
    tasks = [{"name": "talk", "subtasks": ["speech", "nobody"]}, task("speech"), task("nobody"), task("slam")]
    governed.policy(tasks=tasks, contexts=[])
    governed.expect(slam=990, speech=10)
    governed.policy(tasks=[tasks[0] | {"satisfiedBy": "Any"}, *tasks[1:]], contexts=[])
    governed.expect(slam=500, speech=500)


def test_a_task_whose_needs_are_unmet_yields(governed):
    governed.policy(tasks=[task("slam"), task("speech", needs={"cores": "600m", "enforce": "Suspend"})], contexts=[])
    governed.expect(slam=990, speech=10)
    governed.policy(tasks=[task("slam"), task("speech", needs={"cores": "500m", "enforce": "Suspend"})], contexts=[])
    governed.expect(slam=500, speech=500)
