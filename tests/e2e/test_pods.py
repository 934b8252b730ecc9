"""Every kind of pod: resized, or reported with what to do about it, never broken."""

import pytest

from tests.e2e.cluster import apply, delete, get, run, until
from tests.e2e.robot import IDLE, pod, task

GUARANTEED = {"requests": {"cpu": "500m", "memory": "64Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}
NO_LIMIT = {"requests": {"cpu": "10m", "memory": "32Mi"}}
BIG_REQUEST = {"requests": {"cpu": "100m", "memory": "32Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}
EQUAL_MEMORY = {"requests": {"cpu": "100m", "memory": "64Mi"}, "limits": {"cpu": "500m", "memory": "64Mi"}}


@pytest.fixture
def robot(empty):
    return empty


def resources(robot, name):
    return get("pod", name, robot.namespace)["spec"]["containers"][0]["resources"]


def test_guaranteed_pod_moves_request_and_limit_together(robot):
    robot.start("slam", resources=GUARANTEED)
    robot.start("speech")
    robot.policy()
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    assert resources(robot, "slam")["requests"]["cpu"] == "990m"
    assert get("pod", "slam", robot.namespace)["status"]["qosClass"] == "Guaranteed"
    delete("ctxp", "robot", robot.namespace)
    robot.expect(slam=500, speech=500)
    assert resources(robot, "slam") == GUARANTEED


@pytest.mark.parametrize(
    ("given", "said"),
    [({}, "speech is BestEffort, which can't be resized"), (NO_LIMIT, "speech/speech has no CPU limit")],
)
def test_pod_that_cannot_be_resized_is_reported_and_left_alone(robot, given, said):
    robot.start("slam")
    robot.start("speech", resources=given)
    robot.policy()
    robot.expect(slam=1000)
    until("the status shows it", lambda: said in robot.condition("Applied")[1])
    assert resources(robot, "speech") == given


def start_restarting(robot, name):
    """A pod whose container restarts whenever its CPU changes."""
    delicate = pod(name, robot.namespace, IDLE, None)
    policy = {"resourceName": "cpu", "restartPolicy": "RestartContainer"}
    delicate["spec"]["containers"][0]["resizePolicy"] = [policy]
    apply(delicate)
    run("kubectl", "wait", f"pod/{name}", "-n", robot.namespace, "--for=condition=Ready", "--timeout=60s")


def test_container_that_a_resize_restarts_is_reported_and_left_alone(robot):
    robot.start("slam")
    start_restarting(robot, "speech")
    robot.policy()
    for speed in (0.3, 0.0, 0.3):
        robot.drive(speed)
        robot.expect(slam=1000)
    said = "speech/speech restarts whenever its CPU changes"
    until("the status shows it", lambda: said in robot.condition("Applied")[1])
    assert any(said in message for message in robot.reported("NotResizable"))
    assert resources(robot, "speech")["limits"]["cpu"] == "500m"
    assert robot.restarts("speech") == 0


def test_task_that_accepts_restarts_is_restarted_once_for_each_share(robot):
    robot.start("slam")
    start_restarting(robot, "speech")
    robot.policy(tasks=[task("slam"), task("speech", restartOnResize=True)])
    robot.expect(slam=500, speech=500)
    before = robot.restarts("speech")
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    until("it was restarted once", lambda: robot.restarts("speech") == before + 1)
    until("the status is well", lambda: robot.condition("Applied")[0] == "True")
    delete("ctxp", "robot", robot.namespace)
    robot.expect(slam=500, speech=500)
    until("it was restarted once more", lambda: robot.restarts("speech") == before + 2)


def test_limit_of_the_whole_pod_bounds_its_container_and_is_reported(robot):
    """Pod-level resources (KEP-2837): the API server refuses a container more than its pod has."""
    bounded = pod("slam", robot.namespace, IDLE, None)
    bounded["spec"]["resources"] = {"limits": {"cpu": "600m", "memory": "64Mi"}}
    apply(bounded)
    robot.start("speech")
    robot.policy()
    robot.expect(slam=500, speech=500)
    robot.drive(0.3)
    robot.expect(slam=500, speech=10)
    until("the status shows it", lambda: "pod limits of 600m" in robot.condition("Applied")[1])
    assert "set the task's max to the pod's CPU limit" in robot.condition("Applied")[1]
    robot.policy(tasks=[task("slam", max="600m"), task("speech")])
    robot.expect(slam=600, speech=10)
    until("the status is well", lambda: robot.condition("Applied")[0] == "True")


def test_request_above_the_limit_is_reported(robot):
    robot.start("slam")
    robot.start("speech", resources=BIG_REQUEST)
    robot.policy()
    robot.drive(0.3)
    robot.expect(slam=900, speech=100)
    until("the status names it", lambda: "its CPU request of 100m" in robot.condition("Feasible")[1])


def test_burstable_pod_does_not_turn_guaranteed(robot):
    """With equal memory a limit equal to the request would change the class, which the API refuses."""
    robot.start("slam")
    robot.start("speech", resources=EQUAL_MEMORY)
    robot.policy()
    robot.drive(0.3)
    robot.expect(slam=890, speech=110)
    until("the status is well", lambda: robot.condition("Applied")[0] == "True")


def test_two_tasks_in_one_pod_and_a_sidecar(robot):
    """Several containers of one pod move in one patch; the sidecar, an init container that stays, as well."""
    both = pod("slam", robot.namespace, IDLE, None)
    container = both["spec"]["containers"][0]
    both["spec"]["containers"].append({**container, "name": "speech"})
    both["spec"]["initContainers"] = [{**container, "name": "map", "restartPolicy": "Always"}]
    apply(both)
    run("kubectl", "wait", "pod/slam", "-n", robot.namespace, "--for=condition=Ready", "--timeout=60s")
    labels = {"matchLabels": {"app": "slam"}}
    robot.policy(
        tasks=[task("slam"), {**task("speech"), "selector": labels}, {**task("map"), "selector": labels, "max": "100m"}]
    )
    robot.drive(0.3)

    def limits():
        spec = get("pod", "slam", robot.namespace)["spec"]
        every = [*spec["containers"], *spec["initContainers"]]
        now = {entry["name"]: entry["resources"]["limits"]["cpu"] for entry in every}
        return True if now == {"slam": "890m", "speech": "10m", "map": "100m"} else now

    until("all three containers have their share", limits)
    robot.expect(slam=890)


def requests(robot):
    return {name: resources(robot, name)["requests"]["cpu"] for name in ("slam", "speech")}


def limits(robot):
    return {name: resources(robot, name)["limits"]["cpu"] for name in ("slam", "speech")}


def test_weights_are_requests_that_always_fit(robot):
    """Two tasks of at most 800m divide 1000m: a request is 0.625 of a weight, and no order of resizes is deferred."""
    robot.start("slam", "speech")
    robot.policy(enforcement={"control": "Weight"}, tasks=[task("slam", max="800m"), task("speech", max="800m")])
    moving, standing = {"slam": "500m", "speech": "2m"}, {"slam": "312m", "speech": "312m"}
    for _ in range(5):
        robot.drive(0.3)
        until("slam's request is its weight", lambda: requests(robot) == moving or requests(robot))
        assert limits(robot) == {"slam": "800m", "speech": "10m"}
        robot.drive(0.0)
        until("requests are alike", lambda: requests(robot) == standing or requests(robot))
        assert limits(robot) == {"slam": "800m", "speech": "800m"}
    assert robot.reported("ResizePending") == []
    delete("ctxp", "robot", robot.namespace)
    original = {"slam": "10m", "speech": "10m"}
    until("requests are restored", lambda: requests(robot) == original or requests(robot))
    assert limits(robot) == {"slam": "500m", "speech": "500m"}


def test_suspend_control_leaves_other_tasks_untouched(robot):
    robot.start("slam", "speech")
    before = resources(robot, "slam")
    robot.policy(enforcement={"control": "Suspend"})
    robot.drive(0.3)
    robot.expect(slam=500, speech=10)
    robot.drive(0.0)
    robot.expect(slam=500, speech=500)
    assert resources(robot, "slam") == before
