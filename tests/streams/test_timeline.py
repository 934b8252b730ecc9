"""Timeline files: what they mean in time, and that every mistake in them is reported at once."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from contextpolicy.errors import TimelineError
from contextpolicy.policy.ros_types import type_store
from contextpolicy.policy.stream_spec import RosRelease
from contextpolicy.streams import cdr
from contextpolicy.streams.ros_message import RosMessage
from contextpolicy.streams.timeline import StoryPhase, TimedInput, _runs, load, parse

TIMELINES = Path(__file__).parents[2] / "timelines"
SCHEMA = Draft202012Validator(json.loads((TIMELINES / "schema.json").read_text(encoding="utf-8")))
FILES = sorted(set(TIMELINES.glob("*.json")) - {TIMELINES / "schema.json"})

ONCE = {"key": "robot/battery", "encoding": "json", "at": 1.5, "value": {"charge": 0.4}}
REPEATED = {"key": "robot/imu", "encoding": "json", "from": 1, "to": 2, "rate": 4, "value": {"speed": 0.3}}
RECORDED = {"key": "robot/microphone", "encoding": "binary", "from": 0, "to": 2, "dataset": "speech/demo"}
SCAN = {
    "key": "0/scan/LaserScan/hash",
    "encoding": "cdr",
    "type": "sensor_msgs/msg/LaserScan",
    "from": 0,
    "to": 2,
    "rate": 10,
    "value": {"ranges": [1, "Infinity", "-Infinity", "NaN"]},
}


def a_document(*inputs):
    return {"name": "test", "duration": 2, "inputs": list(inputs)}


def test_there_are_timelines_to_check():
    assert FILES


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_shipped_timeline_satisfies_schema_and_loader(path):
    SCHEMA.validate(json.loads(path.read_text(encoding="utf-8")))
    timeline = load(path)
    times = [timed.at for timed in timeline.inputs()]
    assert times == sorted(times)
    assert 0 <= times[0] <= times[-1] <= timeline.duration


def test_inputs_of_all_entries_come_in_time_order():
    timeline = parse(a_document(REPEATED, ONCE, RECORDED))
    assert [(timed.at, timed.key) for timed in timeline.inputs()] == [
        (0.0, "robot/microphone"),
        (1.0, "robot/imu"),
        (1.25, "robot/imu"),
        (1.5, "robot/imu"),
        (1.5, "robot/battery"),
        (1.75, "robot/imu"),
    ]


def test_a_data_set_is_announced_once():
    timeline = parse(a_document(RECORDED))
    expected = TimedInput(0.0, "robot/microphone", "binary", None, "speech/demo")
    assert list(timeline.inputs()) == [expected]


def test_rate_and_offset_of_a_data_set_are_kept():
    (entry,) = parse(a_document({**RECORDED, "rate": 10, "offset": 1.5})).entries
    assert (entry.rate, entry.dataset_rate, entry.offset) == (None, 10, 1.5)
    assert len(list(entry.inputs())) == 1


def test_phases_describe_the_story():
    phases = [{"name": "stands", "from": 0, "to": 1}, {"name": "drives", "from": 1, "to": 2, "truth": {"moving": True}}]
    document = {**a_document(ONCE), "phases": phases}
    SCHEMA.validate(document)
    assert parse(document).phases == (StoryPhase("stands", 0, 1), StoryPhase("drives", 1, 2, {"moving": True}))


def test_every_mistake_in_a_phase_is_reported():
    document = {**a_document(ONCE), "phases": [{"name": "x", "from": 1, "to": 3, "speed": 1}, 7]}
    assert not SCHEMA.is_valid(document)
    with pytest.raises(TimelineError) as error:
        parse(document)
    assert [finding.field for finding in error.value.findings] == ["phases[0].speed", "phases[0].to", "phases[1]"]


def test_inputs_are_lazy():
    endless = {**REPEATED, "from": 0, "to": 1e9, "rate": 1000}
    timeline = parse({**a_document(endless), "duration": 1e9})
    first = list(itertools.islice(timeline.inputs(), 3))
    assert [timed.at for timed in first] == [0.0, 0.001, 0.002]


def test_a_rate_that_does_not_divide_the_interval_stays_inside_it():
    timeline = parse(a_document({**REPEATED, "from": 0, "to": 1, "rate": 3}))
    assert [round(timed.at, 3) for timed in timeline.inputs()] == [0.0, 0.333, 0.667]


def at(time, key="a"):
    return {**ONCE, "key": key, "at": time}


@pytest.mark.parametrize(
    ("inputs", "count"),
    [
        ([at(0.0), at(0.5), at(0.5), at(2.0)], 1),
        ([at(0.5), at(0.0), at(2.0)], 2),
        ([at(0.0), REPEATED, at(0.5), at(1.0)], 3),
    ],
)
def test_inputs_in_time_order_form_one_run(inputs, count):
    assert len(list(_runs(parse(a_document(*inputs)).entries))) == count


def test_inputs_of_one_instant_come_in_the_order_of_the_file():
    timeline = parse(a_document(at(1.0, "a"), REPEATED, at(1.0, "b"), at(0.0, "c"), at(1.0, "d")))
    assert [timed.key for timed in timeline.inputs() if timed.at == 1.0] == ["a", REPEATED["key"], "b", "d"]


def test_all_mistakes_are_reported_at_once():
    broken = {"key": "/robot//imu", "encoding": "xml", "from": 5, "to": 1, "rate": 0, "valeu": 1}
    with pytest.raises(TimelineError) as caught:
        parse({"name": "", "duration": 2, "inputs": [broken, 7]}, subject="exp.json")
    fields = {finding.field for finding in caught.value.findings}
    assert fields == {
        "name",
        "inputs[0].value",
        "inputs[0].valeu",
        "inputs[0].key",
        "inputs[0].encoding",
        "inputs[0].rate",
        "inputs[0].from",
        "inputs[0].to",
        "inputs[1]",
    }
    assert str(caught.value).startswith("exp.json:\n")


@pytest.mark.parametrize(
    "entry",
    [
        {**ONCE, "at": -1},
        {**ONCE, "at": True},
        {**ONCE, "key": "robot/*"},
        {**REPEATED, "rate": 1e6},
        {**RECORDED, "dataset": "../secrets"},
        {**RECORDED, "encoding": "cdr"},
        {**RECORDED, "rate": 0},
        {**RECORDED, "offset": -1},
        {**ONCE, "offset": 1},
        {**ONCE, "encoding": "cdr"},
        {**ONCE, "type": "sensor_msgs/msg/Imu"},
        {**REPEATED, "ros": "jazzy"},
        {**SCAN, "type": "LaserScan"},
        {**SCAN, "ros": "melodic"},
        {**SCAN, "value": 7},
        {"at": 1},
        {},
        None,
    ],
)
def test_schema_and_loader_refuse_the_same(entry):
    document = a_document(entry)
    assert not SCHEMA.is_valid(document)
    with pytest.raises(TimelineError):
        parse(document)


@pytest.mark.parametrize(
    "document",
    [
        *(None, [], {}, "text", {"name": "a", "duration": 1, "inputs": []}),
        *({**a_document(ONCE), "name": name} for name in ("", "a\x01", "a\nb")),
    ],
)
def test_a_document_of_another_shape_is_refused(document):
    assert not SCHEMA.is_valid(document)
    with pytest.raises(TimelineError):
        parse(document)


@pytest.mark.parametrize("content", [b"{", b"\xff", b'{"name": "a", "duration": NaN, "inputs": []}'])
def test_a_file_that_is_not_json_is_refused_by_name(tmp_path, content):
    path = tmp_path / "broken.json"
    path.write_bytes(content)
    with pytest.raises(TimelineError, match=r"broken\.json"):
        load(path)


def test_a_number_beyond_all_doubles_is_not_infinity(tmp_path):
    path = tmp_path / "broken.json"
    path.write_text('{"name": "a", "duration": 1e400, "inputs": []}')
    with pytest.raises(TimelineError, match="1e400 is larger than any double"):
        load(path)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(TimelineError, match=r"missing\.json"):
        load(tmp_path / "missing.json")


def read(message, at, type_name):
    return cdr.reader(type_name, type_store(), max_values=100)(message.payload(at))


def test_a_ros_message_has_what_is_written_and_defaults_for_the_rest():
    first = next(parse(a_document(SCAN)).inputs())
    assert SCHEMA.is_valid(a_document(SCAN))
    scan = read(first.message, 0, SCAN["type"])
    assert scan["ranges"][:3] == [1.0, math.inf, -math.inf]
    assert math.isnan(scan["ranges"][3])
    assert (scan["range_max"], scan["intensities"]) == (0.0, [])


def test_the_stamps_of_headers_move_unless_they_are_given():
    header = {"frame_id": "map", "stamp": {"sec": 7}}
    value = {"transforms": [{"child_frame_id": "base"}, {"header": header}]}
    tf = {**ONCE, "encoding": "cdr", "type": "tf2_msgs/msg/TFMessage", "value": value}
    [timed] = parse(a_document(tf)).inputs()
    for at in (1_700_000_000_250_000_000, 1_700_000_001_000_000_000):
        moving, given = (one["header"]["stamp"] for one in read(timed.message, at, tf["type"])["transforms"])
        assert given == {"sec": 7, "nanosec": 0}
        assert moving == {"sec": at // 10**9, "nanosec": at % 10**9}


def test_values_that_do_not_fit_a_message_are_reported_by_path():
    value = {"gyro": 1, "orientation_covariance": [1], "angular_velocity": {"x": "fast", "y": True}, "header": 5}
    entries = [
        {**ONCE, "encoding": "cdr", "type": "sensor_msgs/msg/Imu", "value": value},
        {**ONCE, "encoding": "cdr", "type": "std_msgs/msg/Int8", "value": {"data": 128}},
        {**ONCE, "encoding": "cdr", "type": "std_msgs/msg/Float32", "value": {"data": 1e39}},
        {**ONCE, "encoding": "cdr", "type": "my_msgs/msg/Mood"},
    ]
    with pytest.raises(TimelineError) as caught:
        parse(a_document(*entries))
    numbers = 'a number, "NaN", "Infinity" or "-Infinity"'
    reported = {finding.field: finding.allowed for finding in caught.value.findings}
    assert reported.pop("inputs[0].value.gyro").startswith("one of the fields header, orientation, ")
    assert reported == {
        "inputs[0].value.header": "an object with fields of std_msgs/msg/Header",
        "inputs[0].value.orientation_covariance": "a list of 9",
        "inputs[0].value.angular_velocity.x": numbers,
        "inputs[0].value.angular_velocity.y": numbers,
        "inputs[1].value.data": "an integer from -128 to 127",
        "inputs[2].value.data": numbers,
        "inputs[3].type": "a message of ROS 2 latest, or of --types DIR",
    }


def test_a_timeline_may_use_own_message_types_and_releases():
    mood = {**ONCE, "encoding": "cdr", "type": "my_msgs/msg/Mood", "value": {"glad": True}}
    assert parse(a_document(mood), (("my_msgs.msg.Mood.msg", "bool glad"),)).entries[0].message
    with pytest.raises(TimelineError, match=r"inputs\[0\]\.type.*my_msgs\.msg\.Mood\.msg: has a syntax error"):
        parse(a_document(mood), (("my_msgs.msg.Mood.msg", "bool"),))
    distance = {**ONCE, "encoding": "cdr", "type": "sensor_msgs/msg/Range", "value": {"variance": 0.1}}
    assert parse(a_document({**distance, "ros": "jazzy"})).entries[0].message
    with pytest.raises(TimelineError, match="variance"):
        parse(a_document({**distance, "ros": "humble"}))


def test_at_twice_the_rate_the_same_inputs_come_in_half_the_time():
    story = load(TIMELINES / "exp3.json")
    twice = story.at_rate(2.0)
    assert twice.duration == story.duration / 2
    before, after = ([one for one in timeline.inputs() if one.dataset is None] for timeline in (story, twice))
    assert [one.key for one in after] == [one.key for one in before]
    assert [one.at for one in after] == pytest.approx([one.at / 2 for one in before])


@pytest.mark.parametrize("release", RosRelease)
def test_every_standard_message_can_be_written_and_read_back(release):
    store = type_store(release)
    for type_name in store.fielddefs:
        message = RosMessage(type_name, store, {})
        assert message.findings == []
        cdr.reader(type_name, store, max_values=100)(message.payload(0))
