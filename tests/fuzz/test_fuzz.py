"""Bad input of all kinds: nothing crashes, nothing hangs, the last good plan stands, each drop is counted."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import cbor2
import ormsgpack
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contextpolicy.cluster.pod_parsing import view
from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.inputs import Gone, Score
from tests.agent.builders import a_message, a_target
from tests.bus import messages
from tests.cluster.builders import a_pod, cpu
from tests.fuzz import targets
from tests.fuzz.documents import APPLIED, REPORT

POLICIES = [
    yaml.safe_load(path.read_text(encoding="utf-8"))
    for path in sorted((Path(__file__).parents[2] / "config/policies").glob("*.yaml"))
    if ".expect" not in path.name
]

numbers = st.one_of(
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.sampled_from([0, -1, 10**400, 1e308, 5e-324, float("nan"), float("inf"), 2**63, 2**64, -(2**63) - 1]),
)
scalars = st.one_of(
    st.none(), st.booleans(), numbers, st.text(max_size=8), st.sampled_from(["\ud800", "\x00", "a" * 2000])
)
names = st.one_of(st.sampled_from(["a", "b", "l", "value", "gyro", "off", "stamp", "shaking"]), st.text(max_size=3))
values = st.recursive(
    scalars,
    lambda below: st.one_of(st.lists(below, max_size=5), st.dictionaries(names, below, max_size=5)),
    max_leaves=12,
)
samples = st.builds(
    Sample,
    st.sampled_from(["x", "x", "x", "nobody"]),
    st.dictionaries(names, values, max_size=6),
    st.one_of(st.none(), st.floats(), st.floats(990, 1100)),
)
placements = st.builds(
    Placement,
    st.dictionaries(st.sampled_from(["n1", "n2"]), st.integers(0, 4000)),
    st.lists(
        st.builds(
            Container,
            st.uuids().map(str),
            st.sampled_from(["slam", "rest", "base", "stranger"]),
            st.sampled_from(["n1", "n2", "n3"]),
            st.integers(0, 3000),
        ),
        max_size=5,
    ).map(tuple),
)
events = st.one_of(
    samples,
    placements,
    st.builds(Gone, st.sampled_from(["x", "y"])),
    st.builds(Score, st.just("slam"), st.just(0), numbers),
)


@given(st.lists(st.tuples(events, st.floats(0, 3)), max_size=12))
@settings(max_examples=150)
def test_any_event_sequence_leaves_a_valid_plan(story):
    robot = targets.Robot()
    for event, after in story:
        robot.take(event, after)


@given(st.lists(st.tuples(st.one_of(events, samples, st.none()), st.floats(0, 3)), max_size=12))
@example([(Sample("x", {}), 0.0), (None, 0.0), (Sample("x", {"b": [10**390]}), 2.0), (None, 0.0)])
@settings(max_examples=150)
def test_edit_in_any_event_sequence_changes_nothing_else(story):
    robot = targets.Robot()
    for event, after in story:
        if event is None:
            robot.edit(after)
        else:
            robot.take(event, after)


@given(st.dictionaries(names, values, max_size=6))
def test_a_dropped_sample_is_counted_by_reason(fields):
    robot = targets.Robot()
    robot.take(Sample("x", fields), 0.5)
    dropped = sum(robot.planner.drops[key] for key in robot.planner.drops if key[0] == "x")
    assert dropped == (robot.planner.streams["x"].value is None)


@given(st.integers(0, 255), st.binary(max_size=400))
@settings(max_examples=200)
def test_any_payload(selector, data):
    targets.payload(bytes([selector]) + data)


@given(st.sampled_from([json.dumps, cbor2.dumps, ormsgpack.packb]), values, st.data())
@settings(max_examples=150)
def test_a_damaged_payload(write, value, data):
    try:
        payload = write(value)
    except (ValueError, TypeError, OverflowError):  # the format has no such value
        return
    payload = bytearray(payload.encode(errors="replace") if isinstance(payload, str) else payload)
    for _ in range(data.draw(st.integers(0, 3))):
        if payload:
            payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    selector = {json.dumps: 0, cbor2.dumps: 1, ormsgpack.packb: 2}[write]
    targets.payload(bytes([selector]) + bytes(payload[: data.draw(st.integers(0, len(payload)))]))


@given(st.integers(3, 10), st.binary(max_size=600), st.booleans())
@settings(max_examples=200)
def test_any_cdr_behind_a_good_header(selector, data, little_endian):
    targets.payload(bytes([selector, 0, little_endian, 0, 0]) + data)


@given(st.one_of(values, st.fixed_dictionaries({"sec": scalars, "nanosec": scalars})))
def test_any_timestamp(stamp):
    targets.timestamp(stamp)


@given(values)
def test_any_body(document):
    targets.body(document)
    targets.body({"metadata": {"name": "x"}, "spec": document})


@given(st.sampled_from(POLICIES), st.data())
@settings(max_examples=200)
def test_a_policy_with_one_field_replaced_or_moved(policy, data):
    document = copy.deepcopy(policy)
    place, key = data.draw(st.sampled_from(list(targets.places(document))))
    place[key] = data.draw(st.one_of(values, st.sampled_from([v[k] for v, k in targets.places(policy)])))
    targets.body(document)


@given(st.binary(max_size=60))
def test_several_damaged_fields(data):
    targets.policy(data)


@given(st.binary(max_size=100))
def test_any_expression(data):
    targets.expression(data)


@given(
    st.sampled_from(
        [
            "x.a > 1.0 && norm(x.l) < 2.0",
            "x.l.exists(v, v > 1.0)",
            "x.m['k'] == null ? x.s : 's'",
            "has(x.a) && x.l[x.a - 1.5] % 2 == -x.a / 4",
            "!heard(x) || age(x) > 1.5",
        ]
    ),
    st.data(),
)
def test_a_damaged_expression(source, data):
    at = data.draw(st.integers(0, len(source)))
    targets.expression((source[:at] + data.draw(st.text("xal.()[]+-%/1'\"", max_size=4)) + source[at:]).encode())


MSG = """uint8 SAD=0
string<=8 NAME='x'
float64[3] a
Inner[<=2] parts
int32 n 5 # why
byte[] rest
================================================================================
MSG: a/Inner
bool b
"""
IDL = """#include "x.idl"
module a { module msg {
  const short N = 2 + 3; typedef double three[3];
  module M_Constants { const octet SAD = 0; };
  @verbatim (language="comment", text="why") struct Inner { boolean b; };
  struct M { @default (value=5) long n; three t; sequence<a::msg::Inner, 2> parts; string<8> s; };
}; };
"""
WORDS = (
    *("[", "]", "<=", "<<", "*", "'", '"', "//", "/*", "=", ";", "{", "__", "\n"),
    *("string[9999999]", "M", "a/M m\n", "None", "9" * 20),
)


@given(st.sampled_from([("a.msg.M.msg", MSG), ("M.idl", IDL)]), st.data())
@settings(max_examples=150)
def test_a_damaged_message_definition(definition, data):
    name, text = definition
    for _ in range(data.draw(st.integers(0, 3))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(start + 12, len(text))))
        text = text[:start] + data.draw(st.one_of(st.sampled_from(WORDS), st.text(max_size=4))) + text[end:]
    targets.definitions(name, text)


@given(st.text(max_size=12), st.text(max_size=60))
def test_any_message_definition(name, text):
    targets.definitions(name, text)
    targets.definitions(f"{name}.idl", text)
    targets.definitions("a.msg.M.msg", text)


def damaged(document, data):
    """A copy with one field replaced, as bytes; Python writes numbers beyond JSON's, and reads them too."""
    document = copy.deepcopy(document)
    place, key = data.draw(st.sampled_from(list(targets.places(document))))
    place[key] = data.draw(values)
    return json.dumps(document).encode()


@given(st.data())
@settings(max_examples=200)
def test_a_damaged_report(data):
    targets.report(damaged(REPORT, data))
    targets.report(b'{"stamp":' + damaged([1, 2, 3], data) + b',"policy":"a/b"}')


@given(st.binary(max_size=200))
@example(b"[" * 100_000)
@example(b'{"missing": {"CFS": [], "Realtime": []}, "processors": Infinity}')
@example(b'{"missing": {"CFS": [], "Realtime": []}, "processors": -3}')
@example(b'{"missing": {"CFS": [], "Realtime": []}, "quotaPeriod": NaN}')
@example(b'{"missing": {"CFS": [], "Realtime": []}, "quotaPeriod": -1}')
def test_any_report(payload):
    targets.report(payload)


@given(st.data())
@settings(max_examples=200)
def test_a_damaged_plan_for_an_agent(data):
    targets.order(damaged(json.loads(a_message(a_target())), data))


@given(st.data())
@settings(max_examples=200)
def test_damaged_messages_on_the_bus(data):
    plans = [(messages.KEY, damaged(messages.plan(sequence=number), data)) for number in range(2)]
    steps = [(messages.APPLIED, damaged(APPLIED, data))]
    targets.shown([*plans, *steps, (messages.KEY, json.dumps(messages.plan(sequence=5)).encode())])


@given(st.binary(max_size=200))
@example(b"[" * 100_000)
def test_any_message_on_the_bus(payload):
    targets.shown([(messages.KEY, payload), (messages.APPLIED, payload)])


@given(st.data())
@settings(max_examples=200)
def test_a_damaged_pod_of_a_watch(data):
    targets.event(damaged({"type": "MODIFIED", "object": a_pod(sidecars={"proxy": cpu("1m", "2m")})}, data))


@given(st.binary(max_size=200))
@example(b"[" * 100_000)
@example(b'{"type": "MODIFIED", "object": {"metadata": []}}')
@example(b'{"type": "MODIFIED", "object": []}')
def test_any_line_of_a_watch(line):
    targets.event(line)


@given(st.sampled_from([200, 403, 404, 409, 422, 429, 500, 504]), st.one_of(st.binary(max_size=200), values.map(repr)))
@example(200, b"[" * 100_000)
@example(500, b"[" * 100_000)
def test_any_answer_to_a_patch(status, body):
    targets.answer(status, body if isinstance(body, bytes) else body.encode(errors="replace"))


numerals = st.from_regex(r"\A[+-]?([0-9]{1,9}(\.[0-9]{0,9})?|\.[0-9]{1,9})\Z")
suffixes = st.from_regex(r"\A([KMGTPE]i|[numkMGTPE]|[eE][+-]?[0-9]{1,2})?\Z")


@given(numerals, suffixes)
def test_any_quantity_that_kubernetes_takes_can_be_read(numeral, suffix):
    quantity = numeral + suffix
    view(a_pod(containers={"slam": cpu(quantity, quantity, (quantity, quantity))}))
