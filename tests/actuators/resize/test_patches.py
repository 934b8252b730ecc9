"""Shares as requests and limits, and the patch that says so."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.actuators.resize.patches import cpu_for, resize_patch
from contextpolicy.cluster.pods import Cpu, view
from contextpolicy.policy.spec import Control
from tests.cluster.builders import a_pod, cpu

BURSTABLE = view(a_pod("slam", {"slam": cpu("100m", "500m")}))
GUARANTEED = view(a_pod("slam", {"slam": cpu("500m", "500m", ("64Mi", "64Mi"))}, qos="Guaranteed"))


def share(pod, amount, control, ceiling=800):
    return cpu_for(pod, pod.containers[0], amount, control, ceiling)


@pytest.mark.parametrize(
    ("control", "expected"),
    [(Control.LIMIT, Cpu(100, 300)), (Control.WEIGHT, Cpu(300, 800)), (Control.BOTH, Cpu(299, 300))],
)
def test_what_a_share_moves(control, expected):
    assert share(BURSTABLE, 300, control) == expected


@pytest.mark.parametrize("control", list(Control))
def test_a_guaranteed_pods_request_and_limit_stay_equal(control):
    assert share(GUARANTEED, 300, control) == Cpu(300, 300)


def test_a_weight_at_its_ceiling_stays_below_the_limit():
    """Equal request and limit could turn the pod Guaranteed, which the API refuses."""
    assert share(BURSTABLE, 800, Control.WEIGHT) == Cpu(799, 800)


def test_a_container_without_a_request_gets_none_from_limits():
    pod = view(a_pod("slam", {"slam": cpu(None, "500m")}))
    assert share(pod, 300, Control.LIMIT) == Cpu(None, 300)


@given(st.integers(1, 400).map(lambda n: n * 10), st.integers(1, 400).map(lambda n: n * 10), st.sampled_from(Control))
def test_a_burstable_pod_never_gets_a_request_above_its_limit_or_equal_to_it(amount, ceiling, control):
    wanted = cpu_for(BURSTABLE, BURSTABLE.containers[0], min(amount, ceiling), control, ceiling)
    assert wanted.limit is not None
    assert wanted.request is not None
    assert control is Control.LIMIT or 2 <= wanted.request < wanted.limit


def test_a_patch_names_containers_and_sidecars_in_their_own_lists_and_no_others():
    pod = view(a_pod("slam", {"slam": cpu("1m", "2m"), "log": cpu("1m", "2m")}, sidecars={"map": cpu("1m", "2m")}))
    assert resize_patch(pod, {"slam": Cpu(100, 1500), "map": Cpu(None, 2000), "unknown": Cpu(1, 2)}) == {
        "spec": {
            "containers": [{"name": "slam", "resources": {"limits": {"cpu": "1500m"}, "requests": {"cpu": "100m"}}}],
            "initContainers": [{"name": "map", "resources": {"limits": {"cpu": "2"}}}],
        }
    }


def test_a_patch_removes_nothing():
    """The API refuses to take a request or a limit away."""
    assert resize_patch(BURSTABLE, {"slam": Cpu(None, None)}) == {
        "spec": {"containers": [{"name": "slam", "resources": {}}]}
    }
