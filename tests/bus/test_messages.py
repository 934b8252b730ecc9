"""What a plan carries to modules, agents and recorders."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from contextpolicy.bus.plan_message import MOST_CORES, message
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.policy.spec import Control, Enforcement, Scheduler
from tests.bus.deciding import POLICY
from tests.cluster.builders import NODE, a_pod, cpu
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task

WHOLE = {NODE: 2000}
"""The policy's weights may add up to the node."""
CONTAINERS = tuple(Container(f"lab/{name}/{name}", name, NODE, limit=500) for name in ("slam", "speech"))


@pytest.fixture
def story():
    story = Story(POLICY, Placement({NODE: 2000}, CONTAINERS))
    story.sample("imu", at=1, speed=0.3)
    return story


def pods(*names):
    return [view(a_pod(name)) for name in names]


def test_message_has_every_field_that_readers_need(story):
    made = message(POLICY, 17, story.last, CONTAINERS, pods("slam", "speech"), WHOLE)
    assert json.loads(json.dumps(made)) == {
        "policy": "lab/robot",
        "run": 17,
        "sequence": story.last.sequence,
        "time": START + 1,
        "mode": "Enforce",
        "scheduler": "CFS",
        "realtime": {"policy": "RR", "period": 0.1},
        "control": "Limit",
        "cause": "imu: context moving entered",
        "contexts": ["moving"],
        "tasks": {
            "slam": {
                "score": 1.0,
                "weight": 10.0,
                "share": 1.99,
                "suspended": False,
                "because": made_because(story, "slam"),
            },
            "speech": {
                "score": 1.0,
                "weight": 0.0,
                "share": 0.01,
                "suspended": True,
                "because": made_because(story, "speech"),
            },
        },
        "nodes": {
            NODE: {
                "capacity": 2.0,
                "scheduler": "CFS",
                "dividedBy": "Weight",
                "tasks": {"slam": 1.99, "speech": 0.01},
            }
        },
        "shortfalls": [],
        "targets": [
            {
                "task": task,
                "node": NODE,
                "namespace": "lab",
                "pod": task,
                "uid": f"uid-{task}",
                "qos": "Burstable",
                "container": task,
                "containerId": f"containerd://{task}",
                "cores": cores,
                "weight": None,
                "quota": cores,
                "held": False,
                "original": 0.5,
                "podLimit": None,
                "request": 0.1,
                "limit": 0.5,
            }
            for task, cores in (("slam", 1.99), ("speech", 0.01))
        ],
    }


def made_because(story, task):
    return story.last.tasks[task].because


def written(control, container, pod=None, *, speed=0.3):
    """What an agent is to write for speech, which is suspended while the robot moves: weight, quota, held."""
    policy = replace(POLICY, enforcement=Enforcement(control=control))
    story = Story(policy, Placement({NODE: 2000}, (CONTAINERS[0], container), agents=frozenset({NODE})))
    story.sample("imu", at=1, speed=speed)
    containers, shown = (CONTAINERS[0], container), view(pod or a_pod("speech"))
    [target] = message(policy, 1, story.last, containers, [shown], WHOLE)["targets"]
    return target["weight"], target["quota"], target["held"]


SPEECH = CONTAINERS[1]


@pytest.mark.parametrize(
    ("control", "moving", "standing"),
    [
        (Control.LIMIT, (None, 0.01, False), (None, 0.18, False)),
        (Control.WEIGHT, (0, 0.01, False), (0.18, 0.5, False)),
        (Control.SUSPEND, (None, 0.01, False), (None, 0.5, False)),
    ],
)
def test_what_an_agent_writes(control, moving, standing):
    assert written(control, SPEECH) == moving
    assert written(control, SPEECH, speed=0.0) == standing


@pytest.mark.parametrize("control", list(Control))
def test_quota_below_what_the_api_allows_is_held(control):
    assert written(control, replace(SPEECH, request=300))[1:] == (0.01, True)
    assert written(control, replace(SPEECH, limit=None))[1:] == (0.01, True)


@pytest.mark.parametrize("control", Control)
@pytest.mark.parametrize("floor", [10, 100])
def test_what_another_writer_insists_on_is_the_quota(control, floor):
    for speed in (0.0, 0.3):
        _, quota, held = written(control, replace(SPEECH, request=floor, left=800), speed=speed)
        assert (quota, held) == (0.8, False)


def test_limit_of_zero_means_no_limit():
    assert written(Control.WEIGHT, replace(SPEECH, limit=0)) == (0, 0.01, True)
    assert written(Control.WEIGHT, replace(SPEECH, limit=0), speed=0.0) == (0.18, None, False)


def test_excessive_limit_is_capped(story):
    containers = (CONTAINERS[0], replace(SPEECH, limit=1_500_000))
    pod = a_pod("speech", {"speech": cpu("10m", "1500")})
    [target] = message(POLICY, 1, story.last, containers, [view(pod)], WHOLE)["targets"]
    assert (target["original"], target["limit"]) == (MOST_CORES, MOST_CORES)
    assert written(Control.WEIGHT, containers[1], speed=0.0)[1] == MOST_CORES


def test_the_limit_of_a_pod_as_a_whole_is_sent(story):
    pod = a_pod("slam")
    pod["spec"]["resources"] = {"limits": {"cpu": "600m"}}
    [target] = message(POLICY, 1, story.last, CONTAINERS, [view(pod)], WHOLE)["targets"]
    assert target["podLimit"] == 0.6


def test_without_a_limit_there_is_no_quota_while_the_task_is_active():
    assert written(Control.WEIGHT, replace(SPEECH, limit=None), speed=0.0) == (0.18, None, False)


@pytest.mark.parametrize("qos", ["Guaranteed", "BestEffort"])
def test_weights_compare_among_burstable_pods_only(qos):
    assert written(Control.WEIGHT, SPEECH, a_pod("speech", qos=qos))[0] is None


def test_realtime_lowers_the_quota_of_suspended_tasks_only():
    tasks = tuple(replace(task, suspended_cpu=50) for task in POLICY.tasks)
    policy = replace(POLICY, tasks=tasks, enforcement=Enforcement(scheduler=Scheduler.REALTIME))
    story = Story(policy, Placement({NODE: 2000}, CONTAINERS))
    story.sample("imu", at=1, speed=0.3)
    targets = message(policy, 1, story.last, CONTAINERS, pods("slam", "speech"), WHOLE)["targets"]
    assert {target["task"]: target["quota"] for target in targets} == {"slam": 0.5, "speech": 0.05}
    assert targets[1]["cores"] < 0.01, "a suspended task leaves realtime, so it takes no part of that budget"


def test_only_containers_with_a_share_are_targets(story):
    targets = message(POLICY, 1, story.last, CONTAINERS[:1], pods("slam", "speech", "other"), WHOLE)["targets"]
    assert [target["container"] for target in targets] == ["slam"]


def test_pod_moved_to_a_node_without_a_plan_is_still_a_target(story):
    moved = [replace(container, node="elsewhere") for container in CONTAINERS]
    targets = message(POLICY, 1, story.last, moved, pods("slam", "speech"), WHOLE)["targets"]
    assert [target["task"] for target in targets] == ["slam", "speech"]


def test_quota_under_weight_is_the_max_of_the_active_context():
    tasks = [a_task("slam", max="1500m"), a_task("speech")]
    contexts = [a_context("moving", "imu.speed > 0.1", {"slam": {"max": "700m"}})]
    policy = a_policy(streams=[a_stream("imu")], tasks=tasks, contexts=contexts, enforcement={"control": "Weight"})
    story = Story(policy, Placement({NODE: 2000}, CONTAINERS))
    quotas = []
    for at, speed in ((1, 0.0), (2, 0.3), (3, 0.0)):
        story.sample("imu", at=at, speed=speed)
        quotas.append(message(policy, 1, story.last, CONTAINERS, pods("slam"), WHOLE)["targets"][0]["quota"])
    assert quotas == [1.5, 0.7, 1.5]


def test_a_container_that_does_not_run_has_no_limit_in_force(story):
    pod = a_pod("slam")
    del pod["status"]["containerStatuses"]
    [target] = message(POLICY, 1, story.last, CONTAINERS, [view(pod)], WHOLE)["targets"]
    assert (target["limit"], target["containerId"]) == (None, "")


def weights(most, **protected):
    """The weights of slam and speech, of which slam has nine tenths of the node."""
    tasks = [a_task("slam", priority=9), a_task("speech", priority=1, **protected)]
    policy = a_policy(streams=[a_stream("imu")], tasks=tasks, contexts=[], enforcement={"control": "Weight"})
    story = Story(policy, Placement({NODE: 2000}, CONTAINERS))
    story.sample("imu", at=1, speed=0.0)
    targets = message(policy, 1, story.last, CONTAINERS, pods("slam", "speech"), most)["targets"]
    return [target["weight"] for target in targets]


def test_weights_are_cut_alike_to_what_they_may_add_up_to():
    assert weights({NODE: 2000}) == [1.8, 0.2]
    assert weights({NODE: 500}) == [0.45, 0.05]
    assert weights({NODE: 500}, protected=True) == [0.321, 0.178]
    assert weights({NODE: 500}, protected=True, min="190m") == [0.31, 0.19]


def test_no_weight_is_written_where_none_is_allowed_for():
    assert weights({}) == weights({"elsewhere": 2000}) == [None, None]
