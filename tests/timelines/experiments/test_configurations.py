"""Every configuration is a valid policy, or none, and what a k3s user would write by hand."""

from __future__ import annotations

import json

import pytest
import yaml

from contextpolicy.policy.parsing import parse
from contextpolicy.policy.quantities import parse_cpu
from timelines.demo import deploy
from timelines.experiments import gate
from timelines.experiments.blocks import HEAVY, Trial
from timelines.experiments.configurations import (
    CONFIGURATIONS,
    LIMITS_GATED,
    LINUX,
    LINUX_ADAPTIVE,
    LINUX_GATED,
    REALTIME,
    STATIC,
    STATIC_GATED,
    STRICTER,
    WEIGHTS,
    WEIGHTS_GATED,
    requests,
)
from timelines.experiments.healths import idle
from timelines.experiments.installation import DEPTH, policy_document, values
from timelines.experiments.stories import HELD_OUT, PAPER
from timelines.experiments.tasks import inputs_of

POLICIES = {story.policy: policy_document(story) for story in (HELD_OUT[0], PAPER[0])}
MISSION = POLICIES["mission"]
WEIGHTS_FOUND = {"slam": 1024, "signs": 512, "speech": 512, "navigation": 256, "imu": 256, "arm": 2}


def variant(configuration, document=MISSION):
    resource = configuration.variant(document, "1200m")
    assert resource is not None
    return resource


@pytest.mark.parametrize("document", POLICIES.values(), ids=POLICIES)
@pytest.mark.parametrize("configuration", CONFIGURATIONS.values(), ids=CONFIGURATIONS)
def test_every_variant_is_a_policy(configuration, document):
    resource = configuration.variant(document, "1200m")
    if resource is None:
        assert not configuration.gated
        return
    policy = parse(resource)
    assert policy.reference == "robot/whole-robot"
    assert policy.mode.acts == configuration.contextual
    if configuration.control:
        assert policy.enforcement.control == configuration.control


def suspensions(resource):
    return {
        context["name"]: sorted(task for task, change in context["tasks"].items() if change.get("suspend"))
        for context in resource["spec"]["contexts"]
    }


def test_gating_is_a_factor_of_its_own():
    gated = suspensions(variant(LINUX_GATED))
    assert gated == {"drive": ["arm"], "talk": ["signs", "signs-left"], "read": ["arm"], "grip": ["slam"]}
    for configuration in (STATIC_GATED, WEIGHTS_GATED, LIMITS_GATED):
        assert suspensions(variant(configuration)) == gated
    assert suspensions(variant(WEIGHTS)) == {context: [] for context in gated}
    lifted = [change for one in variant(WEIGHTS)["spec"]["contexts"] for change in one["tasks"].values()]
    assert lifted == [{"weight": 100}] * 4
    assert LINUX.variant(MISSION, "1200m") is None
    assert [one.relayed for one in (LINUX, LINUX_GATED, WEIGHTS_GATED)] == [False, True, False]


def test_a_plan_that_is_only_reported_reaches_the_modules_as_one_that_is_carried_out():
    tasks = {"slam": {"share": 0.01, "suspended": True}, "arm": {"share": 0.3, "suspended": False}}
    relayed = json.loads(gate.enforced(json.dumps({"mode": "DryRun", "run": 1, "tasks": tasks}).encode()))
    assert relayed["mode"] == "Enforce"
    assert relayed["tasks"]["slam"] == tasks["slam"]
    assert relayed["tasks"]["arm"] == {
        "share": gate.EVERYTHING,
        "suspended": False,
    }  # no hint to do less: nobody divides


def test_weights_have_no_max_and_limits_do():
    assert not any("max" in task for task in variant(WEIGHTS_GATED)["spec"]["tasks"])
    assert all("max" in task for task in variant(LIMITS_GATED)["spec"]["tasks"])


def weights(configuration, policy):
    contexts = variant(configuration, POLICIES[policy])["spec"]["contexts"]
    return [change["weight"] for one in contexts for change in one["tasks"].values() if "weight" in change]


def test_limits_hold_the_critical_task_above_the_others_by_more():
    """A limit leaves it nothing of what they do not use; the paper's policy is written for limits."""
    assert weights(WEIGHTS_GATED, "mission") == [100] * 4
    assert weights(LIMITS_GATED, "mission") == [100 * STRICTER] * 4
    assert weights(LIMITS_GATED, "paper") == weights(WEIGHTS_GATED, "paper")


def test_a_policy_divides_what_its_load_has():
    assert variant(WEIGHTS)["spec"]["reserve"] == "1200m"


def test_realtime_divides_the_period_or_leaves_the_containers_alone():
    policy = parse(variant(REALTIME))
    assert policy.enforcement.scheduler == "Realtime"
    assert policy.enforcement.realtime_fallback == "None"
    assert suspensions(variant(REALTIME)) == suspensions(variant(WEIGHTS_GATED))


def test_the_policies_are_not_changed():
    before = repr(POLICIES)
    for configuration in CONFIGURATIONS.values():
        configuration.variant(MISSION, "1200m")
    assert repr(POLICIES) == before


def test_static_weights_are_requests_in_their_proportions_that_leave_room():
    """The scheduler must find room for all: the operator, the router, and drivers and guards, which request 250m."""
    chart = yaml.safe_load((deploy.REPOSITORY / "charts/contextpolicy/values.yaml").read_text(encoding="utf-8"))
    control = sum(parse_cpu(chart[part]["resources"]["requests"]["cpu"]) for part in ("operator", "router"))
    found = {task: parse_cpu(request) for task, request in requests(WEIGHTS_FOUND, 2).items()}
    assert found["slam"] == pytest.approx(2 * found["signs"], abs=1)
    assert found["arm"] == 10
    assert sum(found.values()) < 2000 - control - 250


def module(configuration, task="slam", story=HELD_OUT[0]):
    trial = Trial(HEAVY, story, configuration, 0, 0)
    return values(trial, policy_document(story), 2, WEIGHTS_FOUND)["modules"][task]


def test_queues_are_the_modules_own_but_under_the_papers_terms():
    assert module(LINUX) == {"cpu": {"limit": ""}, "env": {"KEEP_RUNS": "true", "ADAPT": "false"}}
    deep = module(LINUX, story=PAPER[0])
    assert deep["env"]["INPUT_STEREO"] == f"{{depth: {DEPTH}}}"
    assert "memory" in deep


def test_the_second_camera_s_reader_is_the_module_signs_on_keys_of_its_own():
    left = module(WEIGHTS_GATED, "signs-left")
    assert (left["module"], left["enabled"], left["cpu"]) == ("signs", True, {"limit": "2"})
    assert left["env"]["INPUT_PICTURE"] == inputs_of("signs-left")["picture"] == "robot/camera/left"
    assert left["env"]["KEEP_RUNS"] == "true"
    assert inputs_of("signs") == {"picture": "robot/camera/side"}


def test_only_what_a_policy_resizes_has_a_limit():
    assert module(WEIGHTS_GATED)["cpu"] == {"limit": "2"}
    assert module(STATIC)["cpu"]["limit"] == ""
    assert parse_cpu(module(STATIC)["cpu"]["request"]) > 100


def test_modules_listen_to_the_gate_where_nothing_acts_and_adapt_where_they_should():
    assert module(LINUX_GATED)["env"]["PLAN_KEY"] == gate.KEY
    assert "PLAN_KEY" not in module(WEIGHTS_GATED)["env"]
    assert module(LINUX_ADAPTIVE)["env"]["ADAPT"] == "true"


@pytest.mark.parametrize(
    ("health", "expected"),
    [
        (None, False),
        ({"stamp": 10**9, "queue": 0, "suspended": False}, False),  # said before
        ({"stamp": 3 * 10**9, "queue": 2, "suspended": False}, False),
        ({"stamp": 3 * 10**9, "queue": 0, "suspended": False}, True),
        ({"stamp": 3 * 10**9, "queue": 2, "suspended": True}, True),
    ],
)
def test_a_task_is_idle_when_its_health_reports_it(health, expected):
    assert idle(health, 2.0) is expected
