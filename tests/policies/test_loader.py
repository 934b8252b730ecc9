"""Message types of one's own, from a ConfigMap that the policy names."""

from __future__ import annotations

import builtins
import json
from typing import TYPE_CHECKING, cast

import pytest

from contextpolicy.planning.planner import Planner
from contextpolicy.policies.loader import load
from contextpolicy.policy import cel
from contextpolicy.policy.ros_types import type_store
from contextpolicy.policy.tenants import Tenants
from contextpolicy.streams.ros_message import RosMessage
from tests.actuators.resize.fake_cluster import FakeCluster
from tests.planning.builders import a_context, a_stream, a_task
from tests.planning.quiet import Quiet
from tests.policies.builders import a_policy

if TYPE_CHECKING:
    from contextpolicy.cluster.fencing import PolicyApi

MOOD = "robot/mood"
GLAD = b"\0\1\0\0\1"
DEFINITION = {"my_msgs.msg.Mood.msg": "bool glad", "README.md": "the robot's own messages"}


@pytest.fixture
def operator(operator):
    operator.list_all()
    operator.connect()
    return operator


def moody(generation=1, **stream):
    mood = a_stream("mood", encoding="cdr", **{"type": "my_msgs/msg/Mood", "types": "robot-types", **stream})
    contexts = [a_context("glad", "mood.glad", {"slam": {"weight": 8}, "speech": {"weight": 2}})]
    return a_policy(generation=generation, streams=[mood], contexts=contexts)


def hear(operator, payload):
    operator.session.deliver_bytes(MOOD, payload)
    operator.turn()
    operator.settle()


def test_messages_are_decoded_as_the_config_map_defines_them(operator):
    operator.cluster.config_maps["lab/robot-types"] = DEFINITION
    assert operator.apply(moody()).result() is True
    hear(operator, GLAD)
    assert operator.limits() == {"slam": 800, "speech": 200}


def test_without_the_config_map_the_policy_waits_and_says_so_once(operator):
    assert operator.apply(moody()).result() is False
    assert operator.apply(moody()).result() is False
    operator.turn(1.0)
    reported = (
        "spec.streams[0].types: invalid value 'robot-types': expected a ConfigMap of namespace lab that the chart's "
        'rosTypes names; configmaps "robot-types" not found (HTTP 404)'
    )
    assert operator.condition("Accepted") == ("False", "Invalid", reported)
    assert operator.reported() == [("Invalid", reported)]
    operator.cluster.config_maps["lab/robot-types"] = DEFINITION
    assert operator.apply(moody()).result() is True
    operator.turn(1.0)
    assert operator.condition("Accepted")[0] == "True"


def test_an_invalid_definition_is_reported_and_the_last_version_kept(operator):
    operator.cluster.config_maps["lab/robot-types"] = DEFINITION
    operator.apply(moody())
    operator.cluster.config_maps["lab/robot-types"] = {"my_msgs.msg.Mood.msg": "bool glad\nbool"}
    assert operator.apply(moody(2)).result() is True, "it was read, and has to be edited"
    operator.turn(1.0)
    status, _, message = operator.condition("Accepted")
    assert status == "False"
    assert "my_msgs.msg.Mood.msg: has a syntax error in line 2" in message
    hear(operator, GLAD)
    assert operator.limits() == {"slam": 800, "speech": 200}


def test_a_changed_definition_counts_from_the_next_change_of_the_policy(operator):
    operator.cluster.config_maps["lab/robot-types"] = DEFINITION
    operator.apply(moody())
    operator.cluster.config_maps["lab/robot-types"] = {"my_msgs.msg.Mood.msg": "uint8[3] colour\nbool glad"}
    operator.apply(moody())
    hear(operator, b"\0\1\0\0" + bytes([9, 9, 9, 1]))
    assert operator.limits() == {"slam": 800, "speech": 200}


def test_non_finite_values_stay_inside_the_module(operator):
    """JSON has no NaN and no Infinity: the API server and the bus would refuse all that stands around one."""
    scan = "sensor_msgs/msg/LaserScan"
    near = {"name": "near", "op": "min", "of": "min(mood.ranges)", "over": "1s"}
    contexts = [
        a_context("crowded", "mood.near < 1.0", {"slam": {"weight": 8}}),
        a_context("alone", "mood.ranges.all(r, r > 10.0)", {"slam": {"weight": 2}, "speech": {"weight": 8}}),
    ]
    stream = a_stream("mood", encoding="cdr", type=scan, staleAfter="9s", features=[near])
    operator.apply(a_policy(streams=[stream], contexts=contexts))
    for ranges in (["Infinity", "Infinity"], ["NaN", 0.5], ["NaN"], ["-Infinity"], ["Infinity", "Infinity"]):
        hear(operator, RosMessage(scan, type_store(), {"ranges": ranges}).payload(0))
        operator.turn(0.3)
        json.dumps([operator.cluster.statuses, operator.session.published], allow_nan=False)
    assert operator.condition("Ready")[0] == "True"
    operator.turn(0.8)
    assert operator.limits() == {"slam": 200, "speech": 800}
    [explanation] = operator_answer(operator)
    json.dumps(explanation, allow_nan=False)
    assert explanation["streams"]["mood"]["value"]["ranges"] == ["Infinity", "Infinity"]


def operator_answer(operator):
    query = operator.session.ask("contextpolicy/lab/robot/explain")
    operator.turn()
    return query.answers


def test_types_are_loaded_outside_the_loop(operator, monkeypatch):
    """A robot's first ROS 2 types took 163 ms, in which no sample was heard."""
    kind = "sensor_msgs/msg/MagneticField"
    contexts = [a_context("lost", "mood.magnetic_field.x > 1.0", {"slam": {"weight": 8}})]
    mood = a_stream("mood", encoding="cdr", type=kind)
    adopted = operator.operator.policy_changed(a_policy(streams=[mood], contexts=contexts))
    assert kind in type_store().cache
    monkeypatch.setattr(builtins, "compile", None)
    monkeypatch.setattr(builtins, "exec", None)
    operator.turn()
    monkeypatch.undo()
    assert adopted.result() is True
    assert operator.session.everything_declared().count(MOOD) == 1


def test_nothing_of_a_loaded_policy_is_compiled_on_the_loop(monkeypatch):
    """It takes 10 ms for each 1000 characters, and a policy may have a thousand such conditions."""
    mean = {"name": "mean", "of": "imu.x", "op": "mean", "over": "1s"}
    activity = {"when": "imu.speed > 0.2", "until": "imu.speed < 0.1", "scoreFrom": "imu.speed"}
    spec = a_policy(
        streams=[a_stream("imu", filter="imu.ok", features=[mean])],
        tasks=[a_task("slam", activity=[activity]), a_task("speech", requires=[{"when": "imu.x > 0.0"}])],
        contexts=[a_context("moving", "imu.mean > 0.1", {"slam": {"weight": 8}}, until="imu.mean < 0.1")],
    )
    loaded = load(spec, cast("PolicyApi", FakeCluster()), Tenants())
    assert loaded.policy is not None, loaded.rejected
    compiled: list[str] = []
    compile_now = cel.Expression.__init__

    def noted(expression: cel.Expression, source: str) -> None:
        compiled.append(source)
        compile_now(expression, source)

    monkeypatch.setattr(cel.Expression, "__init__", noted)
    Planner(loaded.policy, Quiet(), {})
    assert compiled == []
