"""Every configuration is a valid policy, or none, and what a k3s user would write by hand."""

from __future__ import annotations

import pytest

from contextpolicy.policy.parsing import parse
from contextpolicy.policy.quantities import parse_cpu
from timelines.experiments.configurations import (
    ALL,
    CFS,
    LINUX_DEFAULT,
    STATIC,
    UNSUSPENDED,
    WEIGHT,
    at_pace,
    autoscalers,
    by_priority,
)
from timelines.experiments.installation import DEPTH, policy_document, values
from timelines.experiments.run import idle

POLICY = policy_document()


def context(spec, name):
    """The context of this name."""
    return next(one for one in spec["contexts"] if one["name"] == name)


@pytest.mark.parametrize("pace", [1.0, 4.0])
@pytest.mark.parametrize("configuration", [one for one in ALL if one.policy], ids=lambda one: one.name)
def test_every_variant_is_a_policy(configuration, pace):
    policy = parse(configuration.variant(at_pace(POLICY, pace)))
    assert policy.reference == "robot/whole-robot"
    assert (policy.enforcement.scheduler == "Realtime") == configuration.realtime


def test_a_faster_pace_scales_delays_and_bounds():
    spec = at_pace(POLICY, 4.0)["spec"]
    tasks = {task["name"]: task for task in spec["tasks"]}
    assert (tasks["imu"]["min"], tasks["imu"]["max"]) == ("400m", "400m")
    assert (tasks["speech"]["min"], tasks["speech"]["max"]) == ("50m", "300m")
    assert context(spec, "moving")["enterAfter"] == "25ms"
    assert [one["hold"] for one in spec["tasks"][0]["activity"]] == ["1250ms", "250ms"]
    assert spec["streams"] == POLICY["spec"]["streams"]


@pytest.mark.parametrize("pace", [1.0, 6.0])
def test_no_task_gets_more_cpu_than_it_needs(pace):
    """Navigation needs 13m at real pace, 28m at six times: at 600m, a third of the node would lie idle."""
    shares = {task: parse_cpu(cpu["limit"]) for task, cpu in by_priority(at_pace(POLICY, pace), 2).items()}
    assert shares["navigation"] == 100
    assert shares["imu"] <= 400


def test_the_shipped_policy_is_not_changed():
    before = repr(POLICY)
    for configuration in ALL:
        configuration.variant(POLICY)
    assert repr(POLICY) == before


def variant(configuration):
    resource = configuration.variant(POLICY)
    assert resource is not None
    return resource


def test_shares_that_are_requests_fit_beside_those_of_other_pods():
    """Operator and router request 100m each, drivers and guards 250m together."""
    assert parse_cpu(variant(WEIGHT)["spec"]["reserve"]) >= 2 * 100 + 250


def test_without_suspension_contexts_still_weight():
    weights = {"slam": {"weight": 20}, "signs": {"weight": 5}}
    assert context(variant(UNSUSPENDED)["spec"], "moving")["tasks"] == weights
    assert "speech" in context(variant(CFS)["spec"], "moving")["tasks"]


def test_static_limits_divide_the_node_by_priority_within_bounds():
    shares = {task: parse_cpu(cpu["limit"]) for task, cpu in by_priority(POLICY, 2).items()}
    assert sum(shares.values()) == 1800  # two cores without the reserve
    tasks = {task["name"]: task for task in POLICY["spec"]["tasks"]}
    assert shares["navigation"] == parse_cpu(tasks["navigation"]["max"])
    assert shares["signs"] == parse_cpu(tasks["signs"]["min"])
    assert shares["slam"] > shares["arm"]  # priorities 10 and 5, none at a bound


def test_static_requests_leave_room_for_other_pods():
    """Operator and router request 100m each, drivers and guards 250m: the scheduler must find room for all."""
    requests = {task: parse_cpu(cpu["request"]) for task, cpu in by_priority(POLICY, 2).items()}
    assert sum(requests.values()) < 2000 - 2 * 100 - 250
    assert requests["slam"] > requests["arm"]


def test_values_remove_limits_and_deepen_queues():
    slam = values(LINUX_DEFAULT, POLICY, 2)["modules"]["slam"]
    assert slam["cpu"] == {"limit": ""}
    assert slam["env"] == {"PUBLISH_RUNS": "true", "ADAPT": "false", "INPUT_STEREO": f"{{depth: {DEPTH}}}"}
    assert values(STATIC, POLICY, 2)["modules"]["slam"]["cpu"] == by_priority(POLICY, 2)["slam"]


def test_autoscalers_move_cpu_in_place_within_the_policys_bounds():
    slam = next(one for one in autoscalers(POLICY, 2) if one["metadata"]["name"] == "slam")
    assert slam["spec"]["updatePolicy"]["updateMode"] == "InPlaceOrRecreate"
    own, others = slam["spec"]["resourcePolicy"]["containerPolicies"]
    assert own["minAllowed"] == {"cpu": "100m"}
    assert own["maxAllowed"] == {"cpu": "1050m"}
    assert others == {"containerName": "*", "mode": "Off"}


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
