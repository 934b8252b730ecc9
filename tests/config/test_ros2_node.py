"""The example of a plain ROS 2 node: what can be known without ROS is right, down to keys and Zenoh's settings."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
import zenoh
from rosbags.typesys import Stores, get_typestore

from contextpolicy.bus.credentials import CA, CERTIFICATE, KEY, client_settings
from contextpolicy.policy.key_expressions import selects
from contextpolicy.policy.parsing import parse
from contextpolicy.policy.validation.check import check
from contextpolicy.simulation.robot import NODE as NODE_NAME
from contextpolicy.simulation.robot import Robot
from contextpolicy.simulation.run import simulate
from robotkit import sidecar
from robotkit.ros import topic_key
from robotkit.sidecar import load
from tests.simulation.stories import a_timeline

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "config" / "ros2-node"
MODULE, NODE = yaml.safe_load_all((EXAMPLE / "node.yaml").read_text(encoding="utf-8"))
POLICY = (EXAMPLE / "policy.yaml").read_text(encoding="utf-8")
POD = NODE["spec"]["template"]
(CONTAINER,), (SIDECAR,) = POD["spec"]["containers"], POD["spec"]["initContainers"]
ENVIRONMENT = {one["name"]: one["value"] for one in CONTAINER["env"]}
OVERRIDES = dict(one.split("=", 1) for one in ENVIRONMENT["ZENOH_CONFIG_OVERRIDE"].split(";"))

KNOWN = {
    "/odom": "nav_msgs/msg/Odometry",
    "/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
"""What slam_toolbox publishes, and what it reads the odometry's frame of (its README, `Published topics`)."""


def test_the_policy_is_valid_by_the_definition_and_by_the_operator():
    assert check([("policy.yaml", POLICY)]).errors == []


@pytest.mark.parametrize(
    ("misses", "rate", "speed", "contexts"),
    [
        (0.0, 0.4, 0.5, {"moving"}),
        (0.0, 0.0, 0.5, {"moving", "silent"}),
        (0.0, 0.0, 0.1, {"moving"}),  # half a metre takes it longer than a window lasts
        (0.2, 0.4, 0.5, {"moving", "late"}),
    ],
)
def test_the_policy_notices_a_node_that_answers_late_or_not_at_all(misses, rate, speed, contexts):
    policy = parse(yaml.safe_load(POLICY))
    driving = {"header": {"frame_id": "odom"}, "twist": {"twist": {"linear": {"x": speed}}}}
    odometry = {"key": topic_key("/odom", KNOWN["/odom"]), "encoding": "cdr", "type": KNOWN["/odom"], "value": driving}
    health = {"key": "robot/slam/health", "encoding": "json", "value": {"misses": misses, "rate": rate}}
    always = [{**odometry, "from": 0, "to": 10, "rate": 20}, {**health, "from": 0, "to": 10, "rate": 1}]
    (*_, last) = simulate(policy, a_timeline(*always), robot=Robot({NODE_NAME: 2000})).plans
    assert set(last.contexts) == contexts


def test_the_policy_selects_the_node():
    policy = parse(yaml.safe_load(POLICY))
    (task,) = policy.tasks
    body = yaml.safe_load(POLICY)["spec"]["tasks"][0]
    assert body["selector"]["matchLabels"].items() <= POD["metadata"]["labels"].items()
    assert NODE["spec"]["selector"]["matchLabels"].items() <= POD["metadata"]["labels"].items()
    assert task.container == CONTAINER["name"]
    assert policy.namespace == NODE["metadata"]["namespace"]


@pytest.mark.parametrize("release", [Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL])
def test_streams_match_the_topics_of_the_node(release):
    """The key of rmw_zenoh: domain, topic, type as DDS has it, hash (docs/design.md of ros2/rmw_zenoh)."""
    store = get_typestore(release)
    heard = {stream.name: stream for stream in parse(yaml.safe_load(POLICY)).streams if stream.type}
    for topic, kind in KNOWN.items():
        package, _, name = kind.split("/")
        key = f"{ENVIRONMENT['ROS_DOMAIN_ID']}{topic}/{package}::msg::dds_::{name}_/{store.hash_rihs01(kind)}"
        stream = heard.pop(topic.strip("/"))
        assert selects(stream.key, key)
        assert stream.type == kind
    assert heard == {}


def test_zenoh_takes_every_setting():
    """rmw_zenoh gives each `key=value` to Zenoh as it is (`zenoh_config.cpp`)."""
    config = zenoh.Config()
    for key, value in OVERRIDES.items():
        config.insert_json5(key, value)
        assert json.loads(config.get_json(key)) == json.loads(value)
    assert json.loads(config.get_json("mode")) == "client"


def test_node_connects_only_to_the_charts_router():
    values = yaml.safe_load((ROOT / "charts" / "robot" / "values.yaml").read_text(encoding="utf-8"))
    assert json.loads(OVERRIDES["connect/endpoints"]) == [values["zenoh"]["connect"]]
    assert json.loads(OVERRIDES["listen/endpoints"]) == []
    assert OVERRIDES["scouting/multicast/enabled"] == OVERRIDES["scouting/gossip/enabled"] == "false"
    assert ENVIRONMENT["RMW_IMPLEMENTATION"] == "rmw_zenoh_cpp"
    assert json.loads(OVERRIDES["connect/timeout_ms"]) == -1  # a client's default of 0 ends the node without a router


def test_node_uses_the_module_credentials(tmp_path):
    values = yaml.safe_load((ROOT / "charts" / "robot" / "values.yaml").read_text(encoding="utf-8"))
    (volume, _), (mount,) = POD["spec"]["volumes"], CONTAINER["volumeMounts"]
    assert volume == {"name": mount["name"], "secret": {"secretName": values["zenoh"]["secret"]}}
    for name in (CA, CERTIFICATE, KEY):
        (tmp_path / name).touch()
    for setting, expected in client_settings(tmp_path).items():
        here = json.loads(json.dumps(expected).replace(str(tmp_path), mount["mountPath"]))
        assert json.loads(OVERRIDES[setting]) == here


def test_its_cpu_can_be_governed():
    resources = CONTAINER["resources"]
    assert resources["requests"]["cpu"] == "10m"
    assert "cpu" not in resources["limits"]
    assert resources["requests"]["memory"] != resources["limits"]["memory"]  # so it is not Guaranteed
    assert {one["resourceName"]: one["restartPolicy"] for one in CONTAINER["resizePolicy"]} == {
        "cpu": "NotRequired",
        "memory": "NotRequired",
    }


def test_images_name_no_registry_and_no_floating_tag():
    assert CONTAINER["image"] == "ros:jazzy-ros-base"
    version = yaml.safe_load((ROOT / "charts" / "robot" / "Chart.yaml").read_text(encoding="utf-8"))["appVersion"]
    assert SIDECAR["image"] == f"contextpolicy-host:{version}"


def test_sidecar_observes_the_node_of_the_policys_task(tmp_path):
    path = tmp_path / "module.yaml"
    path.write_text(MODULE["data"]["module.yaml"], encoding="utf-8")
    module, policy = load(path, {}), parse(yaml.safe_load(POLICY))
    streams = {stream.name: stream for stream in policy.streams}
    assert (module.outputs["pose"].key, module.outputs["pose"].type) == (streams["pose"].key, streams["pose"].type)
    assert selects(module.inputs["scan"].key, topic_key("/scan", "sensor_msgs/msg/LaserScan"))
    said = {one["name"]: one["value"] for one in SIDECAR["env"]}
    assert said["POLICY_TASK"] == policy.tasks[0].name
    assert streams["fares"].key == f"robot/{said['POLICY_TASK']}/health"
    assert said["ZENOH_CONNECT"] in OVERRIDES["connect/endpoints"]


def test_the_sidecar_runs_beside_the_node_and_sees_its_processes():
    assert POD["spec"]["shareProcessNamespace"]
    assert SIDECAR["restartPolicy"] == "Always"
    assert SIDECAR["command"][:3] == ["/opt/module/bin/python", "-m", sidecar.__name__]
    mounted = {mount["name"]: mount["mountPath"] for mount in SIDECAR["volumeMounts"]}
    assert SIDECAR["command"][3] == f"{mounted['module']}/{next(iter(MODULE['data']))}"
    assert {one["name"]: one["value"] for one in SIDECAR["env"]}["ZENOH_CREDENTIALS"] == mounted["bus"]
    assert POD["spec"]["volumes"][1] == {"name": "module", "configMap": {"name": MODULE["metadata"]["name"]}}
