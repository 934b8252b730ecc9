"""What modules say becomes what ROS expects, with its header and its covariance; what can't is refused at the start."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from robotkit import ConfigurationError, Input, Module, Output
from robotkit.module import KINDS, load_module
from robotkit.outputs import _payload
from robotkit.ros import decode, stamp_of, topic_key
from robotkit.ros_check import check
from robotkit.ros_graph import dds_name
from robotkit.ros_outputs import _MAKERS, UNKNOWN, allowed
from robotkit.task import Result

MODULES = Path(__file__).parents[3] / "modules"
STAMP = 1_700_000_000_123_456_789
POSE, ODOMETRY = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
LOCATED = {"position": [1.0, 2.0, 3.0], "orientation": [0.0, 0.0, 0.6, 0.8], "inliers": 80, "state": "tracking"}
TWIST = "geometry_msgs/msg/Twist"
RANGE = "sensor_msgs/msg/Range"
DRIVEN = {"position": [1.5, -0.5], "heading": math.pi / 2, "travelled": 3.0, "forward": 0.2, "turn": -0.3}
COVARIANCE = np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3])


def payload_of(kind, type_name, value, **options):
    output = Output("x", "cdr", type_name, "odom", kind, **options)
    return _payload(Result("x", value), output, STAMP, {"input": "in"})


def message(kind, type_name, value, **options):
    payload = payload_of(kind, type_name, value, **options)
    assert isinstance(payload, bytes)
    found = decode(payload, type_name)
    if hasattr(found, "header"):
        assert (found.header.frame_id, stamp_of(found)) == ("odom", STAMP)
    return found


def test_a_pose_is_a_pose_stamped():
    pose = message("pose", POSE, LOCATED).pose
    assert (pose.position.x, pose.position.z, pose.orientation.z, pose.orientation.w) == (1.0, 3.0, 0.6, 0.8)


@pytest.mark.parametrize("covariance", [COVARIANCE, COVARIANCE.tolist(), COVARIANCE.ravel().tolist()])
def test_a_poses_covariance_goes_along(covariance):
    stamped = message("pose", POSE_WITH_COVARIANCE, {**LOCATED, "covariance": covariance})
    assert stamped.pose.covariance.tolist() == COVARIANCE.ravel().tolist()
    odometry = message("odometry", ODOMETRY, {**DRIVEN, "covariance": covariance, "speed_covariance": covariance})
    assert odometry.pose.covariance.tolist() == odometry.twist.covariance.tolist() == COVARIANCE.ravel().tolist()


def test_an_unknown_covariance_is_large_as_zero_would_be_certain():
    for value in (LOCATED, {**LOCATED, "covariance": None}):
        unknown = message("pose", POSE_WITH_COVARIANCE, value).pose.covariance.reshape(6, 6)
        assert unknown.tolist() == np.diag([UNKNOWN] * 6).tolist()
    odometry = message("odometry", ODOMETRY, DRIVEN)
    assert odometry.pose.covariance[0] == odometry.twist.covariance[0] == odometry.twist.covariance[35] == UNKNOWN


@pytest.mark.parametrize(
    ("state", "published"),
    [
        ("tracking", [POSE, POSE_WITH_COVARIANCE]),
        ("degraded", [POSE, POSE_WITH_COVARIANCE]),
        ("adrift", [POSE_WITH_COVARIANCE]),  # the others have no room for how unsure it is
        ("lost", []),
    ],
)
def test_a_pose_that_is_not_known_is_not_published(state, published):
    value = {**LOCATED, "state": state}
    said = [kind for kind in (POSE, POSE_WITH_COVARIANCE) if payload_of("pose", kind, value) is not None]
    assert said == published


@pytest.mark.parametrize(
    ("state", "published"),
    [
        ("adrift", [ODOMETRY, TWIST]),
        ("lost", [TWIST]),  # the speeds are known all the same
    ],
)
def test_odometry_without_a_pose_is_not_published(state, published):
    value = {**DRIVEN, "state": state}
    said = [name for name in (ODOMETRY, POSE, TWIST) if payload_of("odometry", name, value) is not None]
    assert said == published


def test_a_pose_without_speeds_is_not_odometry():
    """Its twist would be that of a robot which certainly stands."""
    assert ODOMETRY not in allowed("pose")


def test_a_covariance_of_another_size_is_refused():
    with pytest.raises(ValueError, match="has 9 numbers: expected 36"):
        message("pose", POSE_WITH_COVARIANCE, {**LOCATED, "covariance": np.eye(3)})
    with pytest.raises(ValueError, match="speed_covariance has 1 numbers: expected 36"):
        message("odometry", ODOMETRY, {**DRIVEN, "speed_covariance": [0.1]})


def test_odometry_has_pose_and_speeds():
    odometry = message("odometry", ODOMETRY, DRIVEN, child_frame="base_footprint")
    position, orientation = odometry.pose.pose.position, odometry.pose.pose.orientation
    assert (position.x, position.y, position.z) == (1.5, -0.5, 0.0)
    assert (orientation.z, orientation.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (0.2, -0.3)
    assert odometry.child_frame_id == "base_footprint"


def test_speeds_are_a_twist():
    twist = message("odometry", TWIST, DRIVEN)
    stamped = message("odometry", "geometry_msgs/msg/TwistStamped", DRIVEN).twist
    assert (twist.linear.x, twist.angular.z) == (stamped.linear.x, stamped.angular.z) == (0.2, -0.3)


def test_a_laser_scan_has_infinity_where_nothing_was_measured():
    value = {"start_angle": 0.0, "end_angle": 3.0, "ranges": [1.5, 0, 2.5, 0], "range_min": 0.15, "range_max": 12.0}
    scan = message("scan", "sensor_msgs/msg/LaserScan", {**value, "scan_time": 0.18, "time_increment": -0.045})
    assert (round(scan.scan_time, 3), round(scan.time_increment, 3)) == (0.18, -0.045)
    assert scan.ranges.tolist() == [1.5, math.inf, 2.5, math.inf]
    assert (scan.angle_min, scan.angle_max, scan.angle_increment) == (0.0, 3.0, 1.0)
    assert (round(scan.range_min, 3), scan.range_max) == (0.15, 12.0)


@pytest.mark.parametrize(("data", "form"), [(b"\x89PNG\r\n", "png"), (b"\xff\xd8\xff", "jpeg")])
def test_a_picture_is_a_compressed_image(data, form):
    image = message("picture", "sensor_msgs/msg/CompressedImage", data)
    assert (image.format, image.data.tobytes()) == (form, data)


def test_bytes_without_a_kind_are_refused():
    with pytest.raises(TypeError, match="invalid value of 3 bytes: expected the fields of"):
        message("", POSE, b"abc")


def test_every_kind_has_a_message_type():
    assert set(KINDS) == _MAKERS.keys()
    assert all(allowed(kind) for kind in KINDS)


# ------------------------------------------------------------------------------------------------------- at the start

OURS = [
    ("slam", "OUTPUT_POSE", POSE),
    ("slam", "OUTPUT_POSE", POSE_WITH_COVARIANCE),
    ("navigation", "OUTPUT_ODOMETRY", ODOMETRY),
    ("navigation", "OUTPUT_ODOMETRY", "geometry_msgs/msg/Twist"),
    ("lidar", "OUTPUT_SCAN", "sensor_msgs/msg/LaserScan"),
    ("camera", "OUTPUT_PICTURE", "sensor_msgs/msg/CompressedImage"),
]


@pytest.mark.parametrize(("module", "variable", "type_name"), OURS)
def test_our_modules_can_publish_ros_messages(module, variable, type_name):
    override = {variable: f"{{key: out, encoding: cdr, type: {type_name}, frame: map}}"}
    loaded = load_module(MODULES / module / "module.yaml", override)
    check(loaded)
    (output,) = (one for one in loaded.outputs.values() if one.encoding == "cdr")
    assert type_name in allowed(output.kind)


@pytest.mark.parametrize(
    ("module", "override", "words"),
    [
        (
            "slam",
            {"OUTPUT_POSE": "sensor_msgs/msg/Imu"},
            "invalid value 'sensor_msgs/msg/Imu': expected geometry",
        ),
        ("slam", {"OUTPUT_POSE": "sensor_msgs/msg/Nothing"}, "a message of ROS 2 latest; `types` names a folder"),
        ("camera", {"OUTPUT_STEREO": "sensor_msgs/msg/Image"}, "another encoding, or an output with a kind"),
        ("imu", {"INPUT_RAW": "my/msg/Own"}, "inputs.raw.type: invalid value 'my/msg/Own'"),
    ],
)
def test_unsupported_message_types_are_refused_at_the_start(module, override, words):
    overridden = {name: f"{{encoding: cdr, type: {kind}}}" for name, kind in override.items()}
    with pytest.raises(ConfigurationError, match=words):
        check(load_module(MODULES / module / "module.yaml", overridden))


TWIST = "geometry_msgs/msg/Twist"
HASH = "RIHS01_" + 64 * "0"


def problems(entry):
    module = Module("m", inputs={"x": entry}) if isinstance(entry, Input) else Module("m", outputs={"x": entry})
    try:
        check(module)
    except ConfigurationError as error:
        return str(error).splitlines()
    return []


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (Output("pose", "cdr", POSE, kind="pose"), "outputs.x.frame: invalid value ''"),
        (Output("pose", "cdr", POSE), "outputs.x.frame: invalid value ''"),
        (Output("pose", "cdr", POSE, "/map"), "outputs.x.frame: invalid value '/map'"),
        (Output("odom", "cdr", ODOMETRY, "odom", "odometry", child_frame=""), "outputs.x.child_frame: invalid"),
        (Output(topic_key("/pose", TWIST), "cdr", POSE, "map"), f"expected a key of {POSE}, as `type` says"),
        (Output("0/pose/geometry_msgs::msg::dds_::Pose_/*", "cdr", POSE, "map"), f"expected a key of {POSE}"),
        (Input("0/**/geometry_msgs::msg::dds_::Twist_", "cdr", POSE), "inputs.x.key: invalid value '0/**/geometry"),
        (Input(f"0/p/{dds_name(POSE)}/{HASH}", "cdr", POSE), f"inputs.x.key: invalid value '{HASH}'"),
        (Input(topic_key("/sonar", RANGE), "cdr", RANGE, ros="humble"), f"the hash of {RANGE} in ROS 2 humble"),
    ],
)
def test_keys_of_another_type_and_missing_frames_are_refused(entry, said):
    (problem,) = problems(entry)
    assert said in problem


@pytest.mark.parametrize(
    "entry",
    [
        Output("cmd_vel", "cdr", TWIST),  # it has no header
        Output(topic_key("/cmd_vel", TWIST), "cdr", TWIST),
        Output("0/pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_...", "cdr", POSE, "map"),
        Input("0/sonar/sensor_msgs::msg::dds_::Range_/TypeHashNotSupported", "cdr", RANGE, ros="humble"),
        Input("0/pose/*/*", "cdr", POSE),
        Input("pose", "cdr", POSE),
    ],
)
def test_keys_and_frames_that_can_work_are_accepted(entry):
    assert problems(entry) == []


def test_all_errors_are_reported_at_once():
    module = Module(
        "m", inputs={"a": Input("a", "cdr", "no/msg/A")}, outputs={"b": Output("b", "cdr", POSE, kind="picture")}
    )
    with pytest.raises(ConfigurationError, match=r"(?s)inputs\.a\.type.*outputs\.b\.type"):
        check(module)


def test_an_unknown_kind_and_an_unknown_release_are_refused(tmp_path):
    path = tmp_path / "module.yaml"
    path.write_text("name: m\noutputs: {a: {key: a, kind: smell, ros: noetic}}\n")
    with pytest.raises(
        ConfigurationError,
        match=r"(?s)kind: invalid value 'smell'.*ros: invalid value 'noetic': expected one of latest",
    ):
        load_module(path)
