"""Shares as requests and limits, and the patch that says so."""

from __future__ import annotations

from contextpolicy.actuators.resize.patches import resize_patch
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from tests.cluster.builders import a_pod, cpu

BURSTABLE = view(a_pod("slam", {"slam": cpu("100m", "500m")}))
GUARANTEED = view(a_pod("slam", {"slam": cpu("500m", "500m", ("64Mi", "64Mi"))}, qos="Guaranteed"))


def test_a_patch_names_containers_and_sidecars_in_their_own_lists_and_no_others():
    pod = view(a_pod("slam", {"slam": cpu("1m", "2m"), "log": cpu("1m", "2m")}, sidecars={"map": cpu("1m", "2m")}))
    assert resize_patch(pod, {"slam": Cpu(100, 1500), "map": Cpu(None, 2000), "unknown": Cpu(1, 2)}) == {
        "metadata": {"uid": "uid-slam"},
        "spec": {
            "containers": [{"name": "slam", "resources": {"limits": {"cpu": "1500m"}, "requests": {"cpu": "100m"}}}],
            "initContainers": [{"name": "map", "resources": {"limits": {"cpu": "2"}}}],
        },
    }


def test_a_patch_removes_nothing():
    """The API refuses to take a request or a limit away."""
    assert resize_patch(BURSTABLE, {"slam": Cpu(None, None)})["spec"] == {
        "containers": [{"name": "slam", "resources": {}}]
    }
