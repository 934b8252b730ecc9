"""Timeline files: what they mean in time, and that every mistake in them is reported at once."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from contextpolicy.errors import TimelineError
from contextpolicy.streams.timeline import TimedInput, _runs, load, parse

TIMELINES = Path(__file__).parents[2] / "timelines"
SCHEMA = Draft202012Validator(json.loads((TIMELINES / "schema.json").read_text(encoding="utf-8")))
FILES = sorted(set(TIMELINES.glob("*.json")) - {TIMELINES / "schema.json"})

ONCE = {"key": "robot/battery", "encoding": "json", "at": 1.5, "value": {"charge": 0.4}}
REPEATED = {"key": "robot/imu", "encoding": "json", "from": 1, "to": 2, "rate": 4, "value": {"speed": 0.3}}
RECORDED = {"key": "robot/microphone", "encoding": "binary", "from": 0, "to": 2, "dataset": "speech/demo"}


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
def test_a_recording_in_time_order_is_one_run_that_needs_no_merging(inputs, count):
    assert len(list(_runs(parse(a_document(*inputs)).entries))) == count


def test_inputs_of_one_instant_come_in_the_order_of_the_file():
    timeline = parse(a_document(at(1.0, "a"), REPEATED, at(1.0, "b"), at(0.0, "c"), at(1.0, "d")))
    assert [timed.key for timed in timeline.inputs() if timed.at == 1.0] == ["a", REPEATED["key"], "b", "d"]


def test_all_mistakes_are_reported_at_once():
    broken = {"key": "/robot//imu", "encoding": "cdr", "from": 5, "to": 1, "rate": 0, "valeu": 1}
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
        {**RECORDED, "rate": 10},
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


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(TimelineError, match=r"missing\.json"):
        load(tmp_path / "missing.json")
