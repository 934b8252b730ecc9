"""What CPU requests leave of a node, in thousandths of a core."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from contextpolicy.cluster.room import STEPS, PodDemand, demand, fit, party, requested
from contextpolicy.planning.allocation.placement import Container
from tests.cluster.builders import NODE, a_pod, cpu, granted
from tests.planning.builders import a_policy, a_task

TWO = {"slam": cpu("100m", "500m"), "map": cpu("200m", "500m")}
INIT = 10
"""The request of the init container that each pod of these tests has."""


def test_a_pod_takes_what_its_containers_and_sidecars_request():
    assert requested(view(a_pod("slam", TWO, sidecars={"log": cpu("30m", "50m")}))) == 330


def test_a_container_that_requests_nothing_takes_nothing():
    assert requested(view(a_pod("slam", {"slam": cpu(None, None)}))) == INIT


def test_a_request_that_the_kubelet_has_not_granted_takes_nothing():
    assert requested(view(granted("100m", a_pod(containers={"slam": cpu("1900m", "2")})))) == 100


def test_a_pod_that_the_kubelet_has_not_seen_takes_what_it_requests():
    pod = a_pod(containers={"slam": cpu("100m", "500m")})
    assert requested(view(pod | {"status": {"phase": "Pending"}})) == 100


def test_init_containers_count_at_their_peak_beside_the_sidecars_before_them():
    pod = a_pod("slam")
    log = {"name": "log", "resources": cpu("30m", None), "restartPolicy": "Always"}
    pod["spec"]["initContainers"] = [log, {"name": "load", "resources": cpu("500m", None)}]
    assert requested(view(pod)) == 530


def test_the_pods_own_request_and_its_overhead_count():
    pod = a_pod("slam", TWO)
    pod["spec"] |= {"resources": {"requests": {"cpu": "1"}}, "overhead": {"cpu": "50m"}}
    assert requested(view(pod)) == 1050


def test_moved_requests_are_counted_separately():
    assert demand(view(a_pod("slam", TWO)), moved={"lab/slam/map": 400.0}) == PodDemand(100, 400.0, INIT)


def test_a_container_that_another_policy_moved_counts_as_it_was():
    was = demand(view(a_pod("slam", TWO)), lambda _, name: Cpu(50, 500) if name == "map" else None)
    assert was == PodDemand(150, 0, INIT)


@pytest.mark.parametrize(("running", "taken"), [(True, 100), (False, 0)])
def test_a_pod_that_is_deleted_takes_its_part_until_its_containers_have_ended(running, taken):
    pod = a_pod("slam", deletionTimestamp="2026-01-01T00:00:00Z")
    if not running:
        pod["status"]["containerStatuses"] = pod["status"]["initContainerStatuses"] = []
    assert requested(view(pod)) == taken


def test_largest_request_follows_from_the_max_of_each_task():
    policy = a_policy(tasks=[a_task("slam", max="1500m"), a_task("map")])
    containers = [Container("s", "slam", NODE), Container("m", "map", NODE)]
    wide = party(policy, containers, {NODE: 1000})
    assert (wide.asked, wide.moved) == ({NODE: 1000}, {"s": 600.0, "m": 400.0})
    small = party(a_policy(tasks=[a_task("slam", max="300m")]), containers[:1], {NODE: 1000})
    assert (small.asked, small.moved) == ({NODE: 300}, {"s": 300.0})


DEMANDS = st.lists(st.builds(PodDemand, st.integers(0, 2000), st.floats(0, 4000), st.integers(0, 2000)), max_size=6)


@given(st.integers(-2000, 20000), DEMANDS)
def test_smallest_sufficient_cut_is_chosen(left, demands):
    step = fit(left, demands)
    assert 0 <= step <= STEPS
    assert step == 0 or sum(one.taken(step) for one in demands) < left + 1e-3
    assert step == STEPS or sum(one.taken(step + 1) for one in demands) > left - 1e-3


def test_an_init_container_takes_no_room_beside_the_container_that_follows_it():
    """Three pods that request 500m both before and after they have started, on two cores."""
    assert fit(2000, [PodDemand(0, 2000 / 3, 500)] * 3) == STEPS
    assert fit(1800, [PodDemand(0, 1000.0, 500)] * 3) == 6000
