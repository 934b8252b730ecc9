"""What the detector says, on generated sequences whose truth is known; the same samples give the same figures."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from modules.imu import accuracy
from modules.imu.motion import MotionDetector, State
from modules.imu.task import Imu
from robotkit import MessageError, Received, euroc
from robotkit.readings import ImuSample
from timelines.datasets.euroc import Sequence, write_inertial
from timelines.datasets.motion import Motion as Path_

MS = 10**6
G = (0.0, 0.0, 9.81)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corridor")
    write_inertial(folder, Sequence(Path_(duration=60, moving=((5, 15), (20, 22), (30, 50)))))
    return folder


def samples(count, *, gyro=(0.0, 0.0, 0.0), accel=G, noise=0.0, start=0):
    rng = np.random.default_rng(1)
    for index in range(count):
        shaken = rng.normal(0, noise, 6) if noise else np.zeros(6)
        yield ImuSample(start + index * 5 * MS, tuple(gyro + shaken[:3]), tuple(accel + shaken[3:] * 10))


def after(*parts):
    detector = MotionDetector()
    return [detector.feed(sample) for part in parts for sample in part][-1]


def test_standing_and_moving_are_distinguished_in_the_corridor(sequence):
    mav0 = euroc.find(sequence)
    truth = euroc.truth(mav0)
    assert truth is not None
    confusion = accuracy.compare(euroc.imu(mav0), truth)
    assert confusion.recall("still") > 0.93  # it needs up to half a second to be sure that the robot has stopped
    standing_reported = sum(confusion.counts[motion, "still"] for motion in ("moving", "turning"))
    assert standing_reported / confusion.counts.total() < 0.003
    assert min(confusion.recall("turning"), confusion.recall("moving")) > 0.8
    assert confusion.accuracy > 0.88


def test_the_command_prints_the_table(sequence, capsys):
    assert accuracy.main([str(sequence)]) == 0
    assert "| **turning** |" in capsys.readouterr().out
    assert accuracy.main([str(sequence / "nowhere")]) == 2


def test_too_few_samples_give_no_result():
    assert after(samples(7)) is None


def test_a_small_gyro_bias_still_counts_as_standing():
    motion = after(samples(200, gyro=(0.01, -0.02, 0.08), noise=0.002))
    assert motion.state is State.STILL
    assert motion.rate == pytest.approx(0, abs=0.002)


def test_shaking_is_moving():
    assert after(samples(200, noise=0.002), samples(40, noise=0.05, start=10**9)).state is State.MOVING


def test_a_smooth_turn_is_a_turn_also_when_the_sensor_is_mounted_on_its_side():
    turn = samples(100, gyro=(0.3, 0.0, 0.0), accel=(9.81, 0.0, 0.0), start=10**9, noise=0.002)
    motion = after(samples(200, accel=(9.81, 0.0, 0.0), noise=0.002), turn)
    assert motion.state is State.TURNING
    assert motion.rate == pytest.approx(0.3, abs=0.01)


def test_leaning_is_not_a_turn():
    lean = samples(100, gyro=(0.3, 0.0, 0.0), start=10**9, noise=0.002)
    assert after(samples(200, noise=0.002), lean).state is State.MOVING


def test_a_short_rest_is_not_yet_a_standstill():
    moving, rest = samples(200, noise=0.05), list(samples(200, noise=0.002, start=10**9))
    assert after(moving, rest[:60]).state is State.MOVING
    moving = samples(200, noise=0.05)
    assert after(moving, rest).state is State.STILL


@pytest.mark.parametrize("start", [20 * 10**9, -(10**9)])
def test_a_gap_or_a_clock_that_goes_back_starts_afresh(start):
    assert after(samples(200), samples(3, start=start)) is None


def test_the_task_publishes_50_times_a_second_at_any_rate():
    task = Imu()
    text = '{{"stamp": {0}, "gyro": [0, 0, 0], "accel": [0, 0, 9.81]}}'
    raw = [Received(text.format(index * 5 * MS).encode(), 0, 0) for index in range(40)]
    results = [result for sample in raw for result in task.process(sample)]
    assert [result.stamp for result in results] == [at * MS for at in range(0, 200, 20)]
    assert results[0].value == {"gyro": (0.0, 0.0, 0.0), "accel": G}
    last = results[-1].value
    assert isinstance(last, dict)
    assert (last["motion"], last["moving"], last["turning"]) == ("still", False, False)


def test_a_sequence_is_played_with_the_stamps_of_now(sequence):
    ended = threading.Event()
    results = Imu(sequence).produce(ended)
    first, second = next(results), next(results)
    assert first.stamp is not None
    assert second.stamp == first.stamp + 20 * MS
    results.close()


def test_without_a_sequence_nothing_is_produced():
    assert list(Imu().produce(threading.Event())) == []


def test_noise_is_dropped():
    with pytest.raises(MessageError):
        Imu().process(Received(b"noise", 0, 0))
