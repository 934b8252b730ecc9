import pytest

from contextpolicy.policy.key_expressions import key_findings, selects
from tests.planning.builders import a_policy, a_stream, a_task


@pytest.mark.parametrize(
    ("expression", "key", "selected"),
    [
        ("robot/imu", "robot/imu", True),
        ("robot/*", "robot/imu", True),
        ("robot/*", "robot/imu/raw", False),
        ("robot/**", "robot", True),
        ("**/imu", "a/b/imu", True),
        ("robot/im$*", "robot/imu", True),
        ("robot/$*mu", "robot/mu", True),
        ("**", "a/@private", False),
        ("0/imu/data/sensor_msgs::msg::dds_::Imu_/*", "0/imu/data/sensor_msgs::msg::dds_::Imu_/RIHS01_x", True),
        ("robot.imu", "robot-imu", False),
    ],
)
def test_expression_selects_key(expression: str, key: str, selected: bool) -> None:  # noqa: FBT001
    assert selects(expression, key) is selected


@pytest.mark.parametrize("key", ["robot/**/**", "robot/**/*", "robot/im*u"])
def test_what_zenoh_refuses_is_found_before_anything_is_subscribed(key):
    policy = a_policy(streams=[a_stream("imu", key=key), a_stream("mic", liveliness=key)], tasks=[a_task("slam")])
    found = key_findings(policy)
    assert [finding.field for finding in found] == ["spec.streams[0].key", "spec.streams[1].liveliness"]
    assert {finding.value for finding in found} == {key}
    assert "a Zenoh key expression; Invalid Key Expr" in found[0].allowed
    assert "/root" not in str(found[0])


def test_good_key_expressions_are_no_finding():
    streams = [a_stream("imu", key="robot/*/imu/**"), a_stream("mic", liveliness="robot/mic")]
    assert key_findings(a_policy(streams=streams, tasks=[a_task("slam")])) == []
