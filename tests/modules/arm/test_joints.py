from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from modules.arm.joints import NAMES, load_arm
from modules.arm.kinematics import Unreachable
from robotkit import ConfigurationError

PATH = Path(__file__).parents[3] / "modules/arm/arm.yaml"
ARM = load_arm(PATH)
POSTURES = st.fixed_dictionaries({name: st.floats(*ARM.joints[name].angle) for name in NAMES})


def changed(tmp_path, **changes):
    document = yaml.safe_load(PATH.read_text(encoding="utf-8"))
    for field, value in changes.items():
        *path, last = field.split("__")
        part = document
        for name in path:
            part = part[name]
        part[last] = value
    file = tmp_path / "arm.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("joint", "angle", "pulse"),
    [("base", 90, 530), ("base", -90, 2400), ("shoulder", 0, 2400), ("elbow", 45, 530), ("grip", 0, 2400)],
)
def test_pulses_are_inverted_as_in_the_mearms_own_driver(joint, angle, pulse):
    assert ARM.joints[joint].pulse_at(angle) == pulse


@given(POSTURES)
def test_angles_round_trip_through_servo_pulses(posture):
    for name, joint in ARM.joints.items():
        assert joint.angle_at(joint.pulse_at(posture[name])) == pytest.approx(posture[name])


@given(POSTURES)
def test_within_the_workspace_inverse_undoes_forward(posture):
    try:
        ARM.checked(posture)
    except Unreachable:
        return
    assert ARM.posture_at(ARM.grip_at(posture), grip=posture["grip"]) == pytest.approx(posture, abs=1e-3)


@given(st.tuples(*[st.floats(-300, 300)] * 3))
def test_accepted_points_keep_every_limit(point):
    try:
        posture = ARM.posture_at(point, grip=0)
    except Unreachable:
        return
    for name in NAMES:
        least, most = ARM.joints[name].angle
        assert least - 1e-6 <= posture[name] <= most + 1e-6
    assert ARM.grip_at(posture) == pytest.approx(point, abs=1e-6)
    assert point[2] >= ARM.lowest - 1e-6


def test_every_limit_in_the_way_is_named():
    with pytest.raises(Unreachable) as caught:
        ARM.checked({"base": 91, "shoulder": 0, "elbow": -90, "grip": -1})
    assert str(caught.value) == (
        "base: 91.0 degrees: expected -90 to 90; grip: -1.0 degrees: expected 0 to 90; "
        "height: -80 mm: expected at least -60 mm"
    )


def test_all_mistakes_in_a_configuration_are_reported_at_once(tmp_path):
    path = changed(
        tmp_path, links_mm__forearm="long", joints__base__channel=24, joints__elbow__angle_deg=[1], bend_deg=None
    )
    with pytest.raises(ConfigurationError) as caught:
        load_arm(path)
    for problem in (
        "links_mm.forearm: invalid value 'long': expected a number from 1 to 1000",
        "joints.base.channel: invalid value 24: expected a number from 0 to 23",
        "joints.elbow.angle_deg: invalid value [1]: expected a list of 2 numbers",
        "bend_deg: invalid value None: expected a list of 2 numbers",
    ):
        assert problem in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"joints__grip__channel": 0}, "expected a different one for each joint"),
        ({"joints__grip__pulse_us": [1500, 1500]}, "expected two different pulses"),
        ({"joints__grip__angle_deg": [90, 0]}, "expected the smaller angle first"),
        ({"joints__grip__speed_deg_s": 0}, "joints.grip.speed_deg_s: invalid value 0: expected a number from 1 to 360"),
        ({"home_mm": [500, 0, 0]}, "home_mm: position"),
    ],
)
def test_invalid_input_is_refused(tmp_path, changes, problem):
    with pytest.raises(ConfigurationError, match=problem):
        load_arm(changed(tmp_path, **changes))


@pytest.mark.parametrize("text", ["", "[1, 2]", "a: [", "\x00", "joints: 3"])
def test_an_invalid_configuration_is_reported(tmp_path, text):
    file = tmp_path / "arm.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"arm\.yaml"):
        load_arm(file)


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(ConfigurationError, match="No such file"):
        load_arm(tmp_path / "arm.yaml")
