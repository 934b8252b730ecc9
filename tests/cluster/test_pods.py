"""Pods as kubectl shows them -> what matters about them."""

from __future__ import annotations

import json

import pytest

from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from contextpolicy.cluster.resource_quantities import LARGEST_QUANTITY, millicores
from tests.cluster.builders import a_pod, cpu, granted

NOTE = json.dumps({"slam": {"policy": "lab/robot", "request": "100m", "limit": "1"}})
EQUAL = ("64Mi", "64Mi")


def test_a_pod_of_the_api():
    pod = view(a_pod("slam", generation=7, resourceVersion="4711"))
    assert (pod.namespace, pod.name, pod.uid, pod.node, pod.qos) == ("lab", "slam", "uid-slam", "robot-1", "Burstable")
    assert (pod.labels, pod.generation, pod.observed_generation, pod.version) == ({"app": "slam"}, 7, 1, 4711)
    assert (pod.mirror, pod.pending, pod.ended, pod.running) == (False, "", False, True)
    [container] = pod.containers
    assert (container.name, container.list_field, container.container_id) == ("slam", "containers", "containerd://slam")
    assert (container.spec, container.actual) == (Cpu(100, 500), Cpu(100, 500))
    assert (container.memory_request, container.memory_limit) == (64 << 20, 128 << 20)


def test_what_a_view_keeps_is_bounded():
    """Anyone may create pods with tens of thousands of labels and containers, and all views stay in memory."""
    names = [f"c{index}" for index in range(101)]
    labels = dict.fromkeys(names, "")
    pod = granted("7m", a_pod(containers={name: cpu("10m", "20m") for name in names}, labels=labels))
    seen = view(pod)
    assert (seen.labels, seen.containers, seen.reserved) == ({}, (), 707)
    del pod["status"]["containerStatuses"], pod["spec"]["containers"][0], labels["c0"]
    seen = view(pod)
    assert (len(seen.labels), len(seen.containers), seen.reserved) == (100, 100, 10)


def test_a_pod_that_the_kubelet_has_not_seen():
    pod = a_pod()
    del pod["status"], pod["spec"]["nodeName"], pod["metadata"]["labels"], pod["metadata"]["generation"]
    seen = view(pod)
    assert (seen.node, seen.qos, seen.labels, seen.generation, seen.observed_generation) == ("", "", {}, 0, None)
    assert [(c.actual, c.container_id) for c in seen.containers] == [(None, "")]
    assert not seen.running


def test_sidecars_count_and_init_containers_that_end_do_not():
    pod = view(a_pod("slam", {"slam": cpu("10m", "500m")}, sidecars={"map": cpu("20m", "400m")}))
    assert [(c.name, c.list_field, c.spec, c.actual) for c in pod.containers] == [
        ("slam", "containers", Cpu(10, 500), Cpu(10, 500)),
        ("map", "initContainers", Cpu(20, 400), Cpu(20, 400)),
    ]
    assert "wait-for-camera" not in pod.by_name


@pytest.mark.parametrize(
    ("stored", "size"),
    [
        ("128Mi", 128 << 20),
        ("134217728000m", 1 << 27),
    ],
)
def test_memory_in_every_form_that_the_api_stores(stored, size):
    assert view(a_pod("slam", {"slam": cpu("1m", "2m", (stored, stored))})).containers[0].memory_limit == size


def test_containers_without_resources():
    [container] = view(a_pod("slam", {"slam": {}}, qos="BestEffort")).containers
    assert (container.spec, container.memory_limit) == (Cpu(None, None), None)


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ({"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": "full"}, "Deferred: full"),
        ({"type": "PodResizePending", "status": "True", "reason": "Infeasible", "message": "no"}, "Infeasible: no"),
        ({"type": "PodResizeInProgress", "status": "True", "reason": "Error", "message": "EINVAL"}, "Error: EINVAL"),
        ({"type": "PodResizeInProgress", "status": "True"}, ""),
        ({"type": "PodResizePending", "status": "False", "reason": "Deferred"}, ""),
        ({"type": "PodResizePending", "status": "True", "reason": "Deferred"}, "Deferred: "),
    ],
)
def test_pending_resize_has_its_reason(condition, expected):
    assert view(a_pod(conditions=[condition])).pending == expected


@pytest.mark.parametrize(
    ("metadata", "phase", "ended"),
    [
        ({}, "Running", False),
        ({}, "Pending", False),
        ({}, "Succeeded", True),
        ({}, "Failed", True),
        ({"deletionTimestamp": "2026-01-01T00:00:00Z"}, "Running", True),
    ],
)
def test_pods_that_have_ended_or_are_ending(metadata, phase, ended):
    pod = a_pod(**metadata)
    pod["status"]["phase"] = phase
    assert view(pod).ended == ended


def test_containers_run_until_they_have_ended():
    pod = a_pod()
    pod["status"]["containerStatuses"][0]["state"] = {"terminated": {"exitCode": 0}}
    assert not view(pod).running


@pytest.mark.parametrize("version", ["", "v1-abc", "12.5"])
def test_a_version_that_is_not_a_number_counts_as_the_oldest(version):
    assert view(a_pod(resourceVersion=version)).version == 0


@pytest.mark.parametrize(
    ("raw", "millis"),
    [
        ("100m", 100),
        (2, 2000),
        ("100u", 1),
        ("1e3m", 1000),
        ("1500000n", 2),
    ],
)
def test_every_way_to_write_cpu_is_read_and_rounded_up(raw, millis):
    assert millicores(raw) == millis


@pytest.mark.parametrize("raw", ["", "lots", "1.5.5n", "Infinity", "NaN", []])
def test_an_invalid_quantity_is_a_value_error(raw):
    with pytest.raises(ValueError, match=r".+"):
        millicores(raw)


# what can be changed, and how far


def restarting(resource="cpu", restart="RestartContainer"):
    pod = a_pod("slam")
    pod["spec"]["containers"][0]["resizePolicy"] = [{"resourceName": resource, "restartPolicy": restart}]
    return view(pod)


@pytest.mark.parametrize(
    ("pod", "said"),
    [
        (a_pod("slam", {"slam": {}}, qos="BestEffort"), "slam is BestEffort, which can't be resized; give slam a CPU"),
        (
            a_pod("slam", {"slam": cpu("10m", None)}),
            "slam/slam has no CPU limit, and Kubernetes can't remove one once it is set",
        ),
        (
            a_pod("slam", annotations={"kubernetes.io/config.mirror": "x"}),
            "slam is a static pod, which can't be resized",
        ),
    ],
    ids=["best effort", "no limit", "static"],
)
def test_resize_obstacles_are_found(pod, said):
    seen = view(pod)
    assert (seen.obstacle(seen.containers[0]) or "").startswith(said)


def test_a_restart_with_every_resize_is_in_the_way_unless_the_task_accepts_it():
    pod = restarting()
    assert (pod.obstacle(pod.containers[0]) or "").startswith("slam/slam restarts whenever its CPU changes")
    assert "restartOnResize: true" in (pod.obstacle(pod.containers[0]) or "")
    assert pod.obstacle(pod.containers[0], may_restart=True) is None


@pytest.mark.parametrize("policy", [("cpu", "NotRequired"), ("memory", "RestartContainer")])
def test_other_resize_policies_are_not_in_the_way(policy):
    pod = restarting(*policy)
    assert pod.obstacle(pod.containers[0]) is None


@pytest.mark.parametrize("qos", ["Burstable", "Guaranteed"])
def test_ordinary_pods_have_no_resize_obstacle(qos):
    seen = view(a_pod(qos=qos))
    assert seen.obstacle(seen.containers[0]) is None


@pytest.mark.parametrize(
    ("resources", "qos", "floor"),
    [
        (cpu("100m", "500m"), "Burstable", 100),
        (cpu("100m", "500m", None), "Burstable", 100),
        (cpu(None, "500m"), "Burstable", 0),
        (cpu("100m", "500m", EQUAL), "Burstable", 101),  # a limit of 100m would turn the pod Guaranteed
        (cpu("500m", "500m", EQUAL), "Burstable", 500),  # it is not, so another container keeps it from that
        (cpu("500m", "500m", EQUAL), "Guaranteed", 0),  # the request moves with the limit
    ],
)
def test_a_request_is_a_floor_for_the_limit(resources, qos, floor):
    pod = view(a_pod("slam", {"slam": resources}, qos=qos))
    assert pod.floor(pod.containers[0]) == floor


def test_floor_is_the_original_request():
    """A policy that moves requests has moved it; once only limits move it comes back."""
    pod = view(a_pod("slam", {"slam": cpu("799m", "800m")}))
    assert pod.floor(pod.containers[0], Cpu(100, 1000)) == 100


def test_a_pod_that_has_resources_only_as_a_whole_gets_advice_of_its_own():
    pod = a_pod("slam", {"slam": cpu("100m", None)})
    pod["spec"]["resources"] = {"requests": {"cpu": "100m"}, "limits": {"cpu": "1"}}
    [container] = view(pod).containers
    expected = view(pod).obstacle(container) or ""
    assert expected.startswith(
        "slam/slam has no CPU limit of its own, only its pod as a whole has one (spec.resources)"
    )
    assert view(pod).obstacle(container, agent=True) is None
    assert view(pod).limit == 1000
    pod["spec"]["resources"] = {"limits": {"memory": "1Gi"}}
    assert view(pod).limit is None
    assert "has no CPU limit, and Kubernetes can't remove" in (view(pod).obstacle(container) or "")


@pytest.mark.parametrize(
    ("raw", "number"),
    [("1e99", LARGEST_QUANTITY), ("1e9999999", LARGEST_QUANTITY), ("9" * 32, LARGEST_QUANTITY), ("0e99", 0)],
)
def test_huge_quantity_is_capped(raw, number):
    """As Kubernetes takes it; a few letters that take seconds to write out as a number."""
    assert millicores(raw) == number
