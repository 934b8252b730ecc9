from __future__ import annotations

import pytest

from robotkit import ConfigurationError, Input, Needs, Output, load_module

GOOD = """
name: slam
description: Where the robot is.
inputs:
  stereo: {key: robot/camera/stereo, encoding: stereo-frame, depth: 2}
  imu: {key: imu/data, encoding: cdr, type: sensor_msgs/msg/Imu}
outputs:
  pose: {key: robot/slam/pose}
needs: {cores: 1, memory: 150Mi, deadline: 100ms}
environment: {RIG_DIR: a folder}
"""


@pytest.fixture
def file(tmp_path):
    return tmp_path / "module.yaml"


def test_a_module_file_declares_inputs_outputs_and_needs(file):
    file.write_text(GOOD, encoding="utf-8")
    module = load_module(file)
    assert module.inputs == {
        "stereo": Input("robot/camera/stereo", "stereo-frame", depth=2),
        "imu": Input("imu/data", "cdr", "sensor_msgs/msg/Imu"),
    }
    assert module.outputs == {"pose": Output("robot/slam/pose")}
    assert module.needs == Needs(cores=1, memory=150 * 2**20, deadline=0.1)


def test_the_environment_may_name_another_key_or_another_message(file):
    file.write_text(GOOD, encoding="utf-8")
    module = load_module(
        file,
        {
            "INPUT_STEREO": "robot2/camera/stereo",
            "OUTPUT_POSE": (
                "{key: slam/pose, encoding: cdr, type: geometry_msgs/msg/PoseStamped, frame: map, kind: pose}"
            ),
        },
    )
    assert module.inputs["stereo"] == Input("robot2/camera/stereo", "stereo-frame", depth=2)
    assert module.outputs["pose"] == Output("slam/pose", "cdr", "geometry_msgs/msg/PoseStamped", "map", "pose")


@pytest.mark.parametrize("text", ["", "- 1", "name: [", "\0", "7"])
def test_an_invalid_module_file_is_refused(file, text):
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"module\.yaml"):
        load_module(file)


def test_all_problems_are_reported_at_once(file):
    bad = GOOD.replace("depth: 2", "depth: 0").replace("100ms", "soon")
    bad = bad.replace("150Mi", "much").replace("cores: 1", "cores: x")
    bad = bad.replace("a folder}", "a folder, of cameras}")
    file.write_text(bad + "speed: 9\n", encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load_module(file, {"INPUT_IMU": "{key: /imu}"})
    lines = [line.removeprefix(f"{file}: ") for line in str(caught.value).splitlines()]
    assert lines == [
        "speed: invalid value 9: expected only description, environment, inputs, name, needs, outputs",
        "environment.of cameras: invalid value None: expected a string that explains the variable",
        "inputs.stereo.depth: invalid value 0: expected an integer of 1 or more",
        "inputs.imu.key: invalid value '/imu': expected a Zenoh key expression such as robot/camera/stereo",
        "needs.cores: invalid value 'x': expected a CPU quantity such as \"300m\" or 2",
        "needs.memory: invalid value 'much': expected a memory quantity such as \"150Mi\"",
        'needs.deadline: invalid value \'soon\': expected a duration such as "100ms" or "1.5s"',
    ]


def test_a_ros_message_needs_its_type(file):
    file.write_text(GOOD.replace(", type: sensor_msgs/msg/Imu", ""), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"inputs\.imu\.type: invalid value '': expected the ROS message type"):
        load_module(file)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_module(tmp_path / "module.yaml")
