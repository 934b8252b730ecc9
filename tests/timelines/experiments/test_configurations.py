"""Every configuration is a valid policy, or none, and what a k3s user would write by hand."""

from __future__ import annotations

import pytest

from contextpolicy.policy.parsing import parse
from contextpolicy.policy.quantities import parse_cpu
from timelines.experiments.configurations import ALL, CFS, EXPERIMENTS, LINUX_DEFAULT, STATIC, UNSUSPENDED, by_priority
from timelines.experiments.installation import DEPTH, policy_document, values
from timelines.experiments.run import idle

POLICY = policy_document()


@pytest.mark.parametrize("configuration", [one for one in ALL if one.policy], ids=lambda one: one.name)
def test_every_variant_is_a_policy(configuration):
    policy = parse(configuration.variant(POLICY))
    assert policy.reference == "robot/whole-robot"
    assert (policy.scheduler == "Realtime") == configuration.agent


def test_the_shipped_policy_is_not_changed():
    before = repr(POLICY)
    for configuration in ALL:
        configuration.variant(POLICY)
    assert repr(POLICY) == before


def test_without_suspension_contexts_still_weight():
    assert UNSUSPENDED.variant(POLICY)["spec"]["contexts"][0]["tasks"] == {"slam": {"weight": 20}}
    assert "speech" in CFS.variant(POLICY)["spec"]["contexts"][0]["tasks"]


def test_static_limits_divide_the_node_by_priority_within_bounds():
    shares = {task: parse_cpu(cpu["limit"]) for task, cpu in by_priority(POLICY, 2).items()}
    assert sum(shares.values()) == 1500  # two cores without the reserve
    navigation = next(task for task in POLICY["spec"]["tasks"] if task["name"] == "navigation")
    assert shares["navigation"] == parse_cpu(navigation["max"])
    assert abs(shares["slam"] - 2 * shares["signs"]) <= 10  # priorities 10 and 5, in steps of 10m


def test_values_remove_limits_and_deepen_queues():
    slam = values(LINUX_DEFAULT, POLICY, 2)["modules"]["slam"]
    assert slam["cpu"] == {"limit": ""}
    assert slam["env"] == {"PUBLISH_RUNS": "true", "INPUT_STEREO": f"{{depth: {DEPTH}}}"}
    assert values(STATIC, POLICY, 2)["modules"]["slam"]["cpu"]["request"] == by_priority(POLICY, 2)["slam"]["limit"]


def test_every_experiment_has_the_baseline():
    assert all(configurations[0] is LINUX_DEFAULT for configurations in EXPERIMENTS.values())


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
def test_a_task_is_idle_once_it_says_so(health, expected):
    assert idle(health, 2.0) is expected
