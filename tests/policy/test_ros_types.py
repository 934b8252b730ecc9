from contextpolicy.policy.ros_types import type_findings
from contextpolicy.policy.spec import Encoding, Policy, Stream


def test_unknown_types_are_findings_of_the_policy():
    known = Stream("imu", "robot/imu", Encoding.CDR, type="sensor_msgs/msg/Imu")
    unknown = Stream("mood", "robot/mood", Encoding.CDR, type="my_msgs/msg/Mood")
    findings = type_findings(Policy("lab", "robot", (), (known, unknown)))
    assert [(finding.field, finding.value) for finding in findings] == [("spec.streams[1].type", "my_msgs/msg/Mood")]
