from __future__ import annotations

import errno
import json
import os
import queue
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contextpolicy.policy.stream_spec import Encoding, Stream
from contextpolicy.streams.backlog import PER_STREAM, TOTAL, Backlog
from contextpolicy.streams.loop import Loop
from contextpolicy.streams.subscription import inputs
from contextpolicy.streams.timeline import parse
from robotkit.euroc import DatasetError
from tests.modules.robotkit.bus import Matching, ask, client, router
from tests.modules.sounds import write
from tests.streams.heard import Heard
from tests.waiting import PATIENCE
from timelines.replay.__main__ import main
from timelines.replay.player import Options, Report, TimelineInputs, _window, play, publish

TIMELINE: dict[str, Any] = {
    "name": "short",
    "duration": 0.4,
    "inputs": [
        {"key": "robot/imu", "encoding": "json", "from": 0, "to": 0.4, "rate": 10, "value": {"speed": 0.3}},
        {"key": "robot/battery", "encoding": "json", "at": 0.15, "value": 7},
        {"key": "robot/microphone", "encoding": "binary", "from": 0.1, "to": 0.35, "dataset": "speech/x"},
    ],
}


@pytest.fixture
def datasets(tmp_path):
    write(tmp_path / "speech/x/audio.wav", np.zeros(16000))
    return tmp_path


@pytest.fixture(scope="module")
def bus():
    with router() as address, client(address) as player, client(address) as robot:
        yield address, player, robot


def await_listener(player, key):
    """Wait until what is played there is heard."""
    with player.declare_publisher(key) as publisher:
        Matching(publisher).wait(expected=True)


def keys(datasets, options, topics=()):
    inputs = TimelineInputs(parse(TIMELINE), datasets, topics)
    return [(round(at, 3), key.rpartition("/")[2]) for at, key, _ in _window(inputs, options)]


def test_values_and_recordings_are_merged_in_time(datasets):
    assert keys(datasets, Options()) == [
        (0.0, "imu"),
        (0.1, "imu"),
        (0.15, "battery"),
        (0.2, "imu"),
        (0.2, "microphone"),
        (0.3, "imu"),
        (0.3, "microphone"),
    ]


def test_a_part_of_the_timeline_can_be_played(datasets):
    options = Options(start_offset=0.12, playback_duration=0.1)
    assert keys(datasets, options) == [(0.15, "battery"), (0.2, "imu"), (0.2, "microphone")]


def test_topics_can_be_chosen(datasets):
    assert keys(datasets, Options(), ["robot/battery"]) == [(0.15, "battery")]
    assert {key for _, key in keys(datasets, Options(), ["robot/b$*", "robot/microphone"])} == {"battery", "microphone"}
    assert len(keys(datasets, Options(), ["robot/**"])) == 7


def test_a_stretch_of_a_recording_can_be_played(datasets):
    stretch = {**TIMELINE["inputs"][2], "offset": 0.75}
    timed = list(_window(TimelineInputs(parse({**TIMELINE, "inputs": [stretch]}), datasets), Options()))
    assert [round(at, 3) for at, _, _ in timed] == [0.15, 0.25]


def test_samples_arrive_with_their_stamp(bus, datasets):
    _, player, robot = bus
    heard: queue.Queue[tuple[str, bytes]] = queue.Queue()
    robot.declare_subscriber("robot/**", lambda sample: heard.put((str(sample.key_expr), sample.payload.to_bytes())))
    await_listener(player, "robot/imu")
    report = play(parse(TIMELINE), player, stop=threading.Event(), options=Options(rate=4), datasets=datasets)
    assert report.published == {"robot/imu": 4, "robot/battery": 1, "robot/microphone": 2}
    got = [heard.get(timeout=PATIENCE) for _ in range(5)]  # a busy machine's bus may drop one
    assert ("robot/battery", b"7") in got
    assert ("robot/microphone", bytes(3200)) in got
    imu = json.loads(next(payload for key, payload in got if key == "robot/imu"))
    assert imu["speed"] == 0.3
    assert report.started <= imu["stamp"] / 1e9 <= report.finished


SCAN_KEY = "0/scan/sensor_msgs::msg::dds_::LaserScan_/TypeHashNotSupported"
ROS = {
    "name": "ros",
    "duration": 0.4,
    "inputs": [
        {
            "key": SCAN_KEY,
            "encoding": "cdr",
            "type": "sensor_msgs/msg/LaserScan",
            "ros": "humble",
            "from": 0,
            "to": 0.4,
            "rate": 20,
            "value": {"ranges": [1.5, "Infinity", "NaN"]},
        },
        {"key": "0/light", "encoding": "cdr", "type": "std_msgs/msg/Bool", "at": 0.3, "value": {"data": True}},
    ],
}


def test_ros_streams_receive_a_played_timeline(bus):
    _, player, robot = bus
    scan = Stream("scan", SCAN_KEY.rpartition("/")[0] + "/*", Encoding.CDR, type="sensor_msgs/msg/LaserScan")
    light = Stream("light", "0/light", Encoding.CDR, type="std_msgs/msg/Bool")
    heard: queue.Queue[Any] = queue.Queue()
    listener, loop = Heard(), Loop()
    source = inputs(
        robot,
        [replace(scan, timestamp="header.stamp"), light],
        loop,
        listener,
        backlog=Backlog(PER_STREAM, TOTAL),
    )
    subscription = source.subscribe(heard.put)
    for key in (SCAN_KEY, "0/light"):
        await_listener(player, key)
    report = play(parse(ROS), player, stop=threading.Event())
    samples = [heard.get(timeout=PATIENCE)]
    while samples[-1].stream != "light":
        samples.append(heard.get(timeout=PATIENCE))
    subscription.dispose()
    loop.dispose()
    assert listener.drops == []
    scans = [sample for sample in samples if sample.stream == "scan"]
    assert scans[0].value["ranges"][:2] == [1.5, float("inf")]
    stamps = [sample.timestamp for sample in samples]
    assert report.started - 1 <= min(stamps) <= max(stamps) <= report.finished + 1
    assert len({sample.timestamp for sample in scans}) == len(scans) > 1
    assert samples[-1].value == {"data": True}


def test_stop_ends_a_loop_at_once(bus, datasets):
    _, player, _ = bus
    stop = threading.Event()
    stop.set()
    report = play(parse(TIMELINE), player, stop=stop, options=Options(loop=True), datasets=datasets)
    assert report.published == {}


def test_a_missing_data_set_is_reported_before_anything_is_played(bus, tmp_path):
    _, player, _ = bus
    with pytest.raises(DatasetError, match="speech/x"):
        play(parse(TIMELINE), player, stop=threading.Event(), datasets=tmp_path)


class SlowToOpen:
    """Inputs whose recording takes its time to open."""

    name, duration, encodings = "slow", 0.1, {"robot/imu": "json"}

    def __init__(self):
        self.topics, self.opened = {}, 0.0

    def timed(self, _):
        self.opened = time.time()
        yield 0.0, "robot/imu", {"speed": 0.3}


def test_the_clock_starts_when_recordings_are_open(bus):
    """Otherwise the first inputs come late, and in a heap."""
    inputs = SlowToOpen()
    report = publish(inputs, bus[1], stop=threading.Event())
    assert inputs.opened <= report.started
    assert report.published == {"robot/imu": 1}


def test_the_report_reports_how_late_inputs_were():
    report = Report("x", started=1.0, lateness=[index / 1000 for index in range(200)])
    assert report.as_json()["lateness_ms"] == {"p50": 100.0, "p99": 198.0, "max": 199.0}


def test_the_command_plays_and_reports(bus, datasets, capsys):
    address, _, _ = bus
    path = datasets / "short.json"
    path.write_text(json.dumps(TIMELINE), encoding="utf-8")
    arguments = [str(path), "--connect", address, "--datasets", str(datasets), "--rate", "10", "--output", "json"]
    assert main(arguments) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["timeline"], sum(report["published"].values())) == ("short", 7)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["missing.json", "--connect", "tcp/127.0.0.1:1"], "missing.json"), (["FILE", "--connect", ""], "ZENOH_CONNECT")],
)
def test_the_command_reports_bad_arguments(datasets, capsys, arguments, message):
    path = datasets / "short.json"
    path.write_text(json.dumps(TIMELINE), encoding="utf-8")
    assert main([str(path) if argument == "FILE" else argument for argument in arguments]) == 1
    assert message in capsys.readouterr().err


def test_the_command_reports_a_recording_that_cannot_be_written(bus, datasets, tmp_path, capsys):
    address, _, _ = bus
    path, recording = datasets / "short.json", tmp_path / "run.mcap"
    path.write_text(json.dumps(TIMELINE), encoding="utf-8")
    recording.symlink_to("/dev/full")
    arguments = [str(path), "--connect", address, "--datasets", str(datasets), "--rate", "10"]
    assert main([*arguments, "--record", str(recording)]) == 1
    assert os.strerror(errno.ENOSPC) in capsys.readouterr().err


def test_the_command_plays_ones_own_messages(bus, tmp_path, capsys):
    address, _, _ = bus
    mood = {"key": "0/mood", "encoding": "cdr", "type": "my_msgs/msg/Mood", "at": 0.1, "value": {"glad": True}}
    (tmp_path / "mood.json").write_text(json.dumps({"name": "mood", "duration": 0.2, "inputs": [mood]}))
    arguments = [str(tmp_path / "mood.json"), "--connect", address]
    assert main(arguments) == 1
    assert "my_msgs/msg/Mood" in capsys.readouterr().err
    messages = tmp_path / "share/my_msgs/msg"
    messages.mkdir(parents=True)
    assert main([*arguments, "--types", str(tmp_path / "share")]) == 1
    assert "holds no .msg and no .idl files" in capsys.readouterr().err
    (messages / "Mood.msg").write_text("bool glad\n")
    assert main([*arguments, "--types", str(tmp_path / "share")]) == 0


@pytest.mark.parametrize("flag", [["--rate", "0"], ["--rate", "nan"], ["--start-offset", "-1"]])
def test_numbers_that_are_invalid_are_refused(flag):
    with pytest.raises(SystemExit):
        main(["x.json", *flag])


def test_who_asks_while_it_plays_gets_the_newest_input(bus, datasets):
    _, player, robot = bus
    stop = threading.Event()
    options = Options(loop=True)
    playing = threading.Thread(
        target=play,
        args=(parse(TIMELINE), player),
        kwargs={
            "stop": stop,
            "options": options,
            "datasets": datasets,
        },
    )
    playing.start()
    try:
        assert ask(robot, "robot/battery") == ["7"]
    finally:
        stop.set()
        playing.join(PATIENCE)
    assert not [*robot.get("robot/battery", timeout=PATIENCE)]
