"""Parser and definition say the same of each field: what only one of them knows would be dropped, or refused."""

from __future__ import annotations

import copy
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contextpolicy.policy import parsing, task_parsing
from contextpolicy.policy.fields import Fields
from contextpolicy.policy.stream_spec import Clock, Encoding
from tests.crds import agreement
from tests.crds.agreement import QUANTITIES, SAYS, disagreements
from tests.crds.reading import INSIDE, READERS, parsed, readings, values
from tests.crds.schema import nodes, schema

SPEC = schema()["properties"]["spec"]


def test_crd_and_parser_agree_on_every_field():
    assert [*disagreements(SPEC)] == []


def test_every_field_is_compared():
    assert readings().keys() == agreement.fields(SPEC).keys()
    assert len(readings()) > 70


def test_every_reader_has_a_schema_counterpart():
    assert SAYS.keys() == {*READERS}


CHANGES = {
    "a field dropped": ("spec.tasks[].needs", lambda node: node["properties"].pop("deadline"), ".deadline"),
    "a field added": ("spec.tasks[].needs", lambda node: node["properties"].update(gpu={}), ".gpu"),
    "a field of an entry": ("spec.contexts[].tasks.*", lambda node: node["properties"].pop("scale"), ".scale"),
    "a word renamed": ("spec.mode", lambda node: node.update(enum=["Enforced", "DryRun", "Paused"]), ""),
    "no enumeration": ("spec.tasks[].satisfiedBy", lambda node: node.pop("enum"), ""),
    "another default": ("spec.tasks[].needs.enforce", lambda node: node.update(default="Suspend"), ""),
    "another text": ("spec.shadow.health", lambda node: node.update(default="robot/*/misses"), ""),
    "a default too many": ("spec.tasks[].max", lambda node: node.update(default=1), ""),
    "a default that is no word": ("spec.streams[].clock", lambda node: node.update(default="Sim"), ""),
    "no default": ("spec.streams[].encoding", lambda node: node.pop("default"), ""),
    "another one stated": ("spec.tasks[].min", lambda node: node.update(description="Default: 20m."), ""),
    "another word stated": ("spec.streams[].ros", lambda node: node.update(description="Default: jazzy."), ""),
    "a longer list": ("spec.streams", lambda node: node.update(maxItems=65), ""),
    "more entries": ("spec.contexts[].tasks", lambda node: node.update(maxProperties=256), ""),
    "a list of numbers": ("spec.tasks[].subtasks", lambda node: node["items"].update(type="number"), ""),
    "a map to numbers": (
        "spec.tasks[].activity[].with",
        lambda node: node["additionalProperties"].update(type="number"),
        "",
    ),
    "a lower bound": ("spec.tasks[].idle", lambda node: node.update(minimum=-1), ""),
    "a higher one": ("spec.tasks[].idle", lambda node: node.update(minimum=1), ""),
    "an upper bound": ("spec.shadow.tolerance", lambda node: node.update(maximum=2), ""),
    "a tighter one": ("spec.shadow.tolerance", lambda node: node.update(maximum=0.5), ""),
    "a longer key": ("spec.streams[].key", lambda node: node.update(maxLength=257), ""),
    "a shorter expression": ("spec.contexts[].when", lambda node: node.update(maxLength=512), ""),
    "another pattern": ("spec.streams[].name", lambda node: node.update(pattern="^[a-z]{1,63}$"), ""),
    "no pattern": ("spec.streams[].timestamp", lambda node: node.pop("pattern"), ""),
    "another length of a pattern": ("spec.shadow.of", lambda node: node.update(maxLength=63), ""),
    "other units": ("spec.enforcement.minDwell", lambda node: node.update(pattern="^[0-9]+s$"), ""),
    "another quantity": ("spec.reserve", lambda node: node.update(pattern=QUANTITIES["memory"]), ""),
    "another type": ("spec.tasks[].protected", lambda node: node.update(type="string"), ""),
    "a default that nobody states": ("spec.shadow.patience", lambda node: node.pop("default"), ""),
    "no format": ("spec.force.until", lambda node: node.pop("format"), ""),
    "no longer anything": ("spec.streams[].example", lambda node: node.clear(), ""),
    "no longer required": ("spec.streams[]", lambda node: node.update(required=["name"]), ".key"),
    "newly required": ("spec.contexts[]", lambda node: node.update(required=["name", "when"]), ".when"),
    "no rule that asks": ("spec.tasks[].requires[]", lambda node: node.pop("x-kubernetes-validations"), ".when"),
}


@pytest.mark.parametrize(("path", "change", "inside"), CHANGES.values(), ids=CHANGES.keys())
def test_a_change_of_the_definition_alone_is_found(path, change, inside):
    spec = copy.deepcopy(SPEC)
    change(dict(nodes(spec, "spec"))[path])
    (found,) = {sentence.partition(": ")[0] for sentence in disagreements(spec)}
    assert found == path + inside


def test_a_field_that_only_the_parser_knows_is_found(monkeypatch):
    read = task_parsing._needs
    monkeypatch.setattr(task_parsing, "_needs", lambda fields: (fields.flag("gpu"), read(fields))[1])
    (found,) = disagreements(SPEC)
    assert found.startswith("spec.tasks[].needs.gpu: the definition lacks it")


BESIDE = {
    "a word": (parsing, "parse_stream", lambda fields: fields.choice("encoding", Encoding.JSON) is Encoding.CDR),
    "another word": (
        parsing,
        "parse_stream",
        lambda fields: fields.choice("encoding", Encoding.JSON) is not Encoding.JSON,
    ),
    "two words": (
        parsing,
        "parse_stream",
        lambda fields: (
            fields.choice("encoding", Encoding.JSON) is Encoding.CDR
            and fields.choice("clock", Clock.AUTO) is Clock.SOURCE
        ),
    ),
    "a duration": (task_parsing, "_activity", lambda fields: fields.duration("decay")),
    "a large number": (task_parsing, "_activity", lambda fields: (fields.number("score") or 0) > 10),
    "a fraction": (task_parsing, "_activity", lambda fields: 0 < (fields.number("score") or 0) < 1),
    "zero": (task_parsing, "_activity", lambda fields: fields.number("score") == 0),
    "a quantity": (task_parsing, "_needs", lambda fields: (fields.cpu("cores") or 0) > 1),
    "a flag": (parsing, "parse_task", lambda fields: fields.flag("protected")),
    "a flag that is not set": (parsing, "parse_task", lambda fields: not fields.flag("protected")),
    "a string": (task_parsing, "_activity", lambda fields: fields.optional_text("stream")),
    "a string of a set": (parsing, "parse_stream", lambda fields: fields.text("op", pattern="In|Exists") == "Exists"),
    "a list": (parsing, "parse_task", lambda fields: fields.texts("subtasks", limit=16)),
    "a list of objects": (parsing, "parse_task", lambda fields: not fields.nested_list("activity", limit=16)),
    "a map": (task_parsing, "_activity", lambda fields: fields.string_map("with")),
    "an expression": (parsing, "_context", lambda fields: fields.cel("when")),
    "a field that is absent": (parsing, "_context", lambda fields: "when" not in fields),
    "one field without another": (
        task_parsing,
        "_activity",
        lambda fields: "score" in fields and "scoreFrom" not in fields,
    ),
}


@pytest.mark.parametrize(("module", "of", "condition"), BESIDE.values(), ids=BESIDE.keys())
def test_conditionally_parsed_field_is_found(monkeypatch, module, of, condition):
    read = getattr(module, of)
    monkeypatch.setattr(module, of, lambda fields: (condition(fields) and fields.flag("planted"), read(fields))[1])
    assert any(".planted: the definition lacks it" in one for one in disagreements(SPEC))


@pytest.mark.parametrize("reader", QUANTITIES)
@settings(max_examples=50)
@given(data=st.data())
def test_the_parser_reads_what_the_definition_allows_as_a_quantity(reader, data):
    # The parser bounds the digits of a number, the definition the whole text: none is longer than makes sense.
    text = data.draw(st.from_regex(QUANTITIES[reader].replace("+", "{1,3}"), fullmatch=True))
    findings: list[Any] = []
    getattr(Fields({"field": text}, "", findings), reader)("field")
    assert findings == []


OBJECTS = [path + INSIDE[read.reader][0] for path, read in readings().items() if read.reader in INSIDE]


@pytest.mark.parametrize("path", ["spec", *OBJECTS])
def test_code_and_parser_have_the_same_defaults(path):
    """In code a value is made without the fields that a policy leaves out."""
    for value in values(parsed(path, {})[0]):
        for each in fields(value):
            given_value = getattr(value, each.name)
            if each.default is not MISSING and not is_dataclass(given_value) and not isinstance(given_value, tuple):
                assert given_value == each.default, f"{type(value).__name__}.{each.name}"
