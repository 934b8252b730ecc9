from __future__ import annotations

import pytest

from contextpolicy.cluster.nodes import NodeView, allocatable, read_node


@pytest.mark.parametrize(
    ("expected", "millis"),
    [
        ("2", 2000),
        (4, 4000),
        ("1999600u", 1999),
        ("1999999999n", 1999),
        ("0", 0),
        ("2e0", 2000),
    ],
)
def test_allocatable_cpu_is_rounded_down(expected, millis):
    assert allocatable({"status": {"allocatable": {"cpu": expected}}}) == millis


@pytest.mark.parametrize(
    "node",
    [
        *({}, {"status": None}, {"status": {"allocatable": {}}}),
        *({"status": {"allocatable": {"cpu": expected}}} for expected in ("many", "", "Infinity", "NaN")),
    ],
)
def test_a_node_that_is_still_joining_has_no_size(node):
    assert allocatable(node) is None


@pytest.mark.parametrize(
    ("kubelet", "delay"),
    [("v1.33.0", 2.0), ("v1.35.9+k3s1", 2.0), ("v1.36.0", 0.0), ("v1.100.0-rc.1", 0.0), ("v2.0.0", 0.0), ("", 2.0)],
)
def test_old_kubelets_take_seconds_to_resize(kubelet, delay):
    node = {
        "metadata": {"name": "robot-1"},
        "status": {"allocatable": {"cpu": "2"}, "nodeInfo": {"kubeletVersion": kubelet}},
    }
    view = read_node(node)
    assert view == NodeView("robot-1", 2000, kubelet)
    assert view is not None
    assert view.delay == delay


def test_joining_node_without_a_status_is_ignored():
    assert read_node({"metadata": {"name": "robot-1"}, "status": {}}) is None


@pytest.mark.parametrize(
    ("conditions", "ready"),
    [
        (None, True),
        ([{"type": "DiskPressure", "status": "False"}], True),
        ([{"type": "Ready", "status": "True"}], True),
        ([{"type": "Ready", "status": "False"}], False),
        ([{"type": "Ready", "status": "Unknown"}], False),
    ],
)
def test_a_node_that_is_switched_off_is_not_ready(conditions, ready):
    status = {"allocatable": {"cpu": "1"}, "conditions": conditions}
    node = read_node({"metadata": {"name": "robot-1"}, "status": status})
    assert node is not None
    assert node.ready is ready
