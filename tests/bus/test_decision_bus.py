"""Messages of the decision bus as values, and one policy's place on the bus."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.decision_bus import Bus, agent_key, applied_key, message, plan_key, policy_of, topic_key
from contextpolicy.bus.signatures import Signer, Verifier
from contextpolicy.cluster.pods import view
from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.policy.spec import Control, Enforcement, Scheduler
from tests.bus.certificates import signing_keys
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import NODE, a_pod
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task
from tests.virtual_operator import OpenFence

POLICY = a_policy(
    streams=[a_stream("imu")],
    tasks=[a_task("slam", priority=10), a_task("speech")],
    contexts=[a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}})],
)
PLAN = b'{"n":1}'
CONTAINERS = tuple(Container(f"lab/{name}/{name}", name, NODE, limit=500) for name in ("slam", "speech"))


@pytest.fixture
def story():
    story = Story(POLICY, Placement({NODE: 2000}, CONTAINERS))
    story.sample("imu", at=1, speed=0.3)
    return story


def pods(*names):
    return [view(a_pod(name)) for name in names]


def test_a_message_has_all_that_modules_agents_and_recorders_read(story):
    made = message(POLICY, 17, story.last, CONTAINERS, pods("slam", "speech"))
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
    [target] = message(policy, 1, story.last, containers, [shown])["targets"]
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
def test_a_quota_that_the_api_cannot_have_is_held(control):
    assert written(control, replace(SPEECH, request=300))[1:] == (0.01, True)
    assert written(control, replace(SPEECH, limit=None))[1:] == (0.01, True)


def test_without_a_limit_there_is_no_quota_while_the_task_is_active():
    assert written(Control.WEIGHT, replace(SPEECH, limit=None), speed=0.0) == (0.18, None, False)


@pytest.mark.parametrize("qos", ["Guaranteed", "BestEffort"])
def test_weights_compare_among_burstable_pods_only(qos):
    assert written(Control.WEIGHT, SPEECH, a_pod("speech", qos=qos))[0] is None


def test_under_realtime_only_what_is_suspended_has_a_quota():
    tasks = tuple(replace(task, suspended_cpu=50) for task in POLICY.tasks)
    policy = replace(POLICY, tasks=tasks, enforcement=Enforcement(scheduler=Scheduler.REALTIME))
    story = Story(policy, Placement({NODE: 2000}, CONTAINERS))
    story.sample("imu", at=1, speed=0.3)
    targets = message(policy, 1, story.last, CONTAINERS, pods("slam", "speech"))["targets"]
    assert {target["task"]: target["quota"] for target in targets} == {"slam": 0.5, "speech": 0.05}
    assert targets[1]["cores"] < 0.01, "a suspended task leaves realtime, so it takes no part of that budget"


def test_only_containers_with_a_share_are_targets(story):
    targets = message(POLICY, 1, story.last, CONTAINERS[:1], pods("slam", "speech", "other"))["targets"]
    assert [target["container"] for target in targets] == ["slam"]


def test_a_container_that_does_not_run_has_no_limit_in_force(story):
    pod = a_pod("slam")
    del pod["status"]["containerStatuses"]
    [target] = message(POLICY, 1, story.last, CONTAINERS, [view(pod)])["targets"]
    assert (target["limit"], target["containerId"]) == (None, "")


def test_keys():
    assert plan_key("lab", "robot") == "contextpolicy/lab/robot/plan"
    assert applied_key("lab", "robot") == "contextpolicy/lab/robot/applied"
    assert topic_key("lab", "robot", "explain") == "contextpolicy/lab/robot/explain"
    assert agent_key("robot-1") == "contextpolicy/agents/robot-1"
    assert {policy_of(key("lab", "robot")) for key in (plan_key, applied_key)} == {"lab/robot"}


@pytest.fixture
def scheduler():
    return TestScheduler()


@pytest.fixture
def session():
    return FakeSession()


class Asked:
    """What queries are answered with; `plan` is there to be changed."""

    def __init__(self, plan):
        self.plan = plan

    def message(self):
        return self.plan

    def explain(self):
        return {"why": "so"}

    def board(self):
        return {"shows": "all"}


def a_bus(session, scheduler, answers=None, signer=None, fence=None):
    answers, fence = answers or Asked({"n": 1}), fence or OpenFence()
    return Bus(session, POLICY, scheduler, answers, signer=signer, fence=fence)


def test_what_is_published_goes_to_the_policys_keys(session, scheduler):
    bus = a_bus(session, scheduler)
    bus.publish({"n": 1})
    bus.publish_applied({"stage": "accepted"})
    bus.withdraw()
    assert session.published == [
        ("contextpolicy/lab/robot/plan", {"n": 1}),
        ("contextpolicy/lab/robot/applied", {"stage": "accepted"}),
        ("contextpolicy/lab/robot/plan", None),
    ]


def test_questions_are_answered_on_the_loop_with_what_holds_then(session, scheduler):
    answers = Asked({"n": 1})
    a_bus(session, scheduler, answers)
    plan, why = session.ask("contextpolicy/lab/robot/plan"), session.ask("contextpolicy/lab/robot/explain")
    assert (plan.answers, why.answers) == ([], [])
    answers.plan = {"n": 2}
    scheduler.advance_by(1)
    assert (plan.answers, why.answers) == ([{"n": 2}], [{"why": "so"}])


def test_without_a_plan_there_is_no_answer(session, scheduler):
    a_bus(session, scheduler, Asked(None))
    query = session.ask("contextpolicy/lab/robot/plan")
    scheduler.advance_by(1)
    assert query.answers == []


def test_a_token_tells_that_somebody_makes_the_plans(session, scheduler):
    bus = a_bus(session, scheduler)
    assert [token.key for token in session.tokens] == ["contextpolicy/lab/robot/plan"]
    bus.close()
    assert session.everything_declared() == []


def test_plans_withdrawals_and_answers_are_signed(session, scheduler, tmp_path):
    keys = signing_keys(tmp_path)
    verifier, key = Verifier(keys), plan_key("lab", "robot")
    bus = a_bus(session, scheduler, signer=Signer(keys))
    bus.publish({"n": 1})
    bus.withdraw()
    query, why = session.ask(key), session.ask(topic_key("lab", "robot", "explain"))
    scheduler.advance_by(1)
    for payload, attachment in zip((PLAN, None, PLAN), (*session.attachments, *query.attachments), strict=True):
        assert verifier.check(key, payload, attachment, time.time_ns())
    assert why.attachments == [None]


def test_without_a_key_nothing_is_signed(session, scheduler):
    a_bus(session, scheduler).publish({"n": 1})
    assert session.attachments == [None]


def test_an_operator_that_lost_its_lease_is_silent_at_once(session, scheduler):
    fence = OpenFence()
    bus = a_bus(session, scheduler, fence=fence)
    query = session.ask("contextpolicy/lab/robot/plan")
    fence.open = False
    assert bus.publish({"n": 1}) is None
    bus.withdraw()
    bus.publish_applied({"stage": "accepted"})
    scheduler.advance_by(1)
    assert (session.published, query.answers) == ([], [])
