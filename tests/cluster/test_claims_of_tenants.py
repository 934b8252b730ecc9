"""What policies of several namespaces get of one node, and of one namespace beside them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu, PodView
from contextpolicy.policy.spec import Control, Mode, Policy
from contextpolicy.policy.tenants import Tenant, Tenants
from tests.cluster.builders import NODE, a_pod, cpu, granted
from tests.cluster.claimants import NODES, held, policy_of, views
from tests.cluster.claiming import claim


def tenants(**priorities):
    return Tenants({name: Tenant(priority) for name, priority in priorities.items()})


def two_tenants(**limits: str) -> tuple[list[Policy], list[PodView]]:
    """Pods of the same size of node, by namespace; their policies, the first one oldest."""
    pods = [view(a_pod("slam", {"slam": cpu("10m", limit)}, namespace=ns, uid=ns)) for ns, limit in limits.items()]
    return [replace(policy_of("robot", "slam"), namespace=namespace) for namespace in limits], pods


def test_tiny_pod_in_another_namespace_leaves_the_robot_its_cpu():
    """Its policy is the older one and reserves nothing: by age alone it would have all of the node."""
    claims = claim(*two_tenants(elsewhere="10m", lab="800m"), NODES)
    assert held(claims["lab/robot"]) == {"lab/slam/slam": "slam"}
    assert claims["lab/robot"].conflicts == []
    assert claims["lab/robot"].placement.left == {NODE: 800}
    assert claims["elsewhere/robot"].placement.left == {NODE: 10}
    assert claims["elsewhere/robot"].shared == {
        NODE: f"node {NODE}: elsewhere and lab have equal priority, so this policy divides 10m: the sum of its "
        "containers' limits, or its portion by requests where those don't fit"
    }


DEFERRED = {"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": "no room"}


def test_a_request_that_the_kubelet_never_granted_takes_nothing_from_a_robot():
    policies, pods = two_tenants(elsewhere="2", lab="800m")
    greedy = a_pod("slam", {"slam": cpu("1900m", "2")}, namespace="elsewhere", uid="elsewhere", conditions=[DEFERRED])
    pods[0] = view(granted("10m", greedy))
    claims = claim(policies, pods, NODES)
    assert claims["lab/robot"].shared == {}
    assert claims["elsewhere/robot"].obstacles == {
        "slam": "slam/slam requests 1900m, and the kubelet has granted 10m (Deferred: no room); "
        "request what its node has room for"
    }


def test_a_request_written_after_a_policy_began_counts_as_far_as_it_is_granted():
    policies, pods = two_tenants(elsewhere="2", lab="800m")
    pods[0] = view(granted("10m", a_pod("slam", {"slam": cpu("1900m", "2")}, namespace="elsewhere", uid="elsewhere")))
    claims = claim(policies, pods, NODES, lambda uid, _: Cpu(1900, 2000) if uid == "elsewhere" else None)
    assert claims["lab/robot"].placement.left == {NODE: 800}


def test_pods_that_the_kubelet_has_not_admitted_take_nothing_from_a_robot():
    """Whoever may make pods can name the node in them: the kubelet refuses them, and their Deployment makes more."""
    policies, pods = two_tenants(elsewhere="2", lab="800m")
    refused = a_pod("slam", {"slam": cpu("64", "64")}, namespace="elsewhere", uid="elsewhere")
    pods[0] = view(refused | {"status": {"phase": "Pending"}})
    assert claim(policies, pods, NODES)["lab/robot"].placement.left == {NODE: 800}


def test_the_administrators_priority_comes_before_age():
    claims = claim(*two_tenants(elsewhere="10m", lab="800m"), NODES, tenants=tenants(lab=10))
    assert claims["lab/robot"].placement.left == {}
    assert claims["lab/robot"].shared == {}
    assert held(claims["elsewhere/robot"]) == {}
    assert claims["elsewhere/robot"].conflicts == [
        f"node {NODE}: lab/robot come first and leave 0m of 2000m; its containers there need at least 10m"
    ]


@pytest.mark.parametrize(
    ("elsewhere", "lab", "parts"),
    [("1500m", "800m", (1200, 800)), ("64", "64", (1000, 1000)), ("64", "10m", (1990, 10))],
)
def test_large_limits_take_no_more_than_an_equal_part(elsewhere, lab, parts):
    """A pod may say any limit: what its neighbours have must not depend on that."""
    claims = claim(*two_tenants(elsewhere=elsewhere, lab=lab), NODES)
    assert (claims["elsewhere/robot"].placement.left[NODE], claims["lab/robot"].placement.left[NODE]) == parts


def test_contested_cpu_is_divided_by_requests():
    """Two idle pods with huge limits and trivial policies pushed a robot below its own limits by equal parts."""
    policies, pods = two_tenants(one="100", two="100", three="100", lab="1600m")
    pods[3] = view(a_pod("slam", {"slam": cpu("620m", "1600m")}, namespace="lab", uid="lab"))
    claims = claim(policies, pods, NODES)
    assert claims["lab/robot"].conflicts == []
    assert claims["lab/robot"].placement.left == {NODE: 1600}
    assert [claims[f"{name}/robot"].placement.left[NODE] for name in ("one", "three", "two")] == [133, 133, 134]


def test_a_request_counts_as_it_was_before_any_policy():
    policies, pods = two_tenants(elsewhere="64", lab="64")
    claims = claim(policies, pods, NODES, lambda uid, _: Cpu(30, 64_000) if uid == "lab" else None)
    assert claims["lab/robot"].placement.left == {NODE: 1500}


TENS = st.integers(1, 60).map(lambda tens: tens * 10)
HOMES = st.dictionaries(
    st.sampled_from(["lab", "one", "two", "three"]),
    st.lists(st.tuples(TENS, st.integers(0, 100_000)), min_size=1, max_size=3),
    min_size=2,
)


@given(HOMES, st.sampled_from(list(Control)))
def test_neighbours_never_take_a_policys_requested_cpu(homes, control):
    """`homes`: by namespace, the request of each pod, and how much greater its limit is."""
    total = sum(request for pods in homes.values() for request, _ in pods) + 10
    pods = [
        view(a_pod(f"p{n}", {f"p{n}": cpu(f"{own}m", f"{own + more}m")}, namespace=home, uid=f"{home}{n}"))
        for home, own_pods in homes.items()
        for n, (own, more) in enumerate(own_pods)
    ]
    policies = [
        replace(
            policy_of("robot", *(f"p{n}" for n in range(len(own))), enforcement={"control": control.value}),
            namespace=home,
        )
        for home, own in homes.items()
    ]
    claims = claim(policies, pods, {NODE: total})
    left = {home: claims[f"{home}/robot"].placement.left.get(NODE, total) for home in homes}
    assert [own.conflicts for own in claims.values()] == [[]] * len(homes)
    assert all(left[home] >= sum(request for request, _ in own) for home, own in homes.items())
    assert all(left[home] <= sum(request + more for request, more in own) for home, own in homes.items())
    assert sum(left.values()) <= total


def test_a_greater_priority_leaves_its_reserve_for_equals_to_share():
    policies, pods = two_tenants(elsewhere="64", lab="64", first="1")
    policies[2] = replace(policies[2], reserve=600)
    claims = claim(policies, pods, NODES, tenants=tenants(first=1))
    assert [claims[f"{name}/robot"].placement.left.get(NODE) for name in ("first", "elsewhere", "lab")] == [
        None,
        300,
        300,
    ]


def test_additional_policies_do_not_enlarge_a_namespaces_part():
    [elsewhere, lab], pods = two_tenants(elsewhere="64", lab="64")
    pods[1] = view(a_pod("slam", {"slam": cpu("20m", "64")}, namespace="lab", uid="lab"))
    more = view(a_pod("more", {"more": cpu("10m", "64")}, namespace="elsewhere", uid="more"))
    second = replace(policy_of("second", "more"), namespace="elsewhere")
    claims = claim([elsewhere, second, lab], [*pods, more], NODES)
    assert claims["lab/robot"].placement.left == {NODE: 1000}
    assert claims["elsewhere/robot"].placement.left == {NODE: 1000}
    assert claims["elsewhere/second"].conflicts != []


def test_policies_of_a_namespace_divide_only_their_own_containers_cpu():
    [elsewhere, lab], pods = two_tenants(elsewhere="10m", lab="500m")
    more = view(a_pod("more", {"more": cpu("10m", "700m")}))
    claims = claim([elsewhere, lab, policy_of("second", "more")], [*pods, more], NODES)
    assert claims["lab/robot"].placement.left == {NODE: 500}
    assert claims["lab/second"].placement.left == {NODE: 700}


def test_limit_set_by_a_policy_does_not_count_as_the_containers_own():
    policies, pods = two_tenants(elsewhere="1500m", lab="800m")
    claims = claim(policies, pods, NODES, lambda uid, _: Cpu(10, 100) if uid == "elsewhere" else None)
    assert claims["elsewhere/robot"].placement.left == {NODE: 100}


@pytest.mark.parametrize("mode", [Mode.DRY_RUN, Mode.PAUSED])
def test_a_neighbour_that_does_not_enforce_changes_nothing(mode):
    [elsewhere, lab], pods = two_tenants(elsewhere="10m", lab="800m")
    assert claim([replace(elsewhere, mode=mode), lab], pods, NODES)["lab/robot"].placement.left == {}


def test_a_neighbour_on_another_node_changes_nothing():
    policies, [there, here] = two_tenants(elsewhere="10m", lab="800m")
    claims = claim(policies, [replace(there, node="robot-2"), here], {**NODES, "robot-2": 1000})
    assert [own.placement.left for own in claims.values()] == [{}, {}]


def test_a_neighbour_whose_pods_cannot_be_resized_changes_nothing():
    policies, [there, here] = two_tenants(elsewhere="10m", lab="800m")
    assert claim(policies, [replace(there, qos="BestEffort"), here], NODES)["lab/robot"].placement.left == {}


def test_lone_namespace_ignores_tenant_division():
    policies = [policy_of("old", "slam", reserve="500m"), policy_of("young", "speech")]
    assert claim(policies, views("slam", "speech"), NODES)["lab/old"].placement.left == {}


def test_a_reserve_beyond_the_node_leaves_others_no_more_than_the_node():
    policies = [policy_of("old", "slam", reserve="3"), policy_of("young", "speech"), policy_of("youngest", "nav")]
    claims = claim(policies, views("slam", "speech", "nav"), NODES)
    assert [len(held(own)) for own in claims.values()] == [1, 1, 0]
