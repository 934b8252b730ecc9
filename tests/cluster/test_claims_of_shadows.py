"""A shadow is placed as if it stood where its policy is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.cluster.builders import NODE
from tests.cluster.claimants import NODES, held, policy_of, views
from tests.cluster.claiming import claim


def a_shadow(of):
    return policy_of("shadow", "slam", mode="DryRun", shadow={"of": of})


def test_a_shadow_is_placed_as_if_it_stood_where_its_policy_is():
    policies = [policy_of("old", "speech", reserve="500m"), policy_of("base", "slam"), policy_of("young", "nav")]
    pods = views("slam", "speech", "nav")
    claims = claim([*policies, a_shadow("base")], pods, NODES)
    assert held(claims["lab/shadow"]) == {"lab/slam/slam": "slam"}
    assert claims["lab/shadow"].placement.left == {NODE: 500}
    assert {name: own for name, own in claims.items() if name != "lab/shadow"} == claim(policies, pods, NODES)


@pytest.mark.parametrize(
    ("others", "known"),
    [
        ([policy_of("base", "slam"), policy_of("arm", "nav")], ": one of base, arm"),
        ([replace(policy_of("lost", "slam"), namespace="elsewhere")], "; none runs"),
    ],
)
def test_shadow_of_an_unknown_policy_lists_the_running_ones(others, known):
    result = claim([*others, a_shadow("lost")], views("slam"), NODES)["lab/shadow"]
    assert held(result) == {}
    problem = f"invalid value 'lost': expected a running policy of namespace lab{known}"
    assert result.conflicts == [f"spec.shadow.of: {problem}"]
