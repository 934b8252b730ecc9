import sys

import pytest

from contextpolicy.errors import DefinitionError
from contextpolicy.policy.definition_files import of_config_map, of_folder
from contextpolicy.policy.message_definitions import MAX_DEPTH, MAX_ITEMS
from contextpolicy.policy.ros_types import is_known, type_findings, type_store
from contextpolicy.policy.spec import Policy
from contextpolicy.policy.stream_spec import Encoding, RosRelease, Stream

MOOD = ("my_msgs.msg.Mood.msg", "# how it feels\nstd_msgs/Header header\nfloat64 joy\nNote[] notes  # newest last\n")
NOTE = ("my_msgs.msg.Note.msg", "uint8 SAD=0\nuint8 kind\nstring<=20 text")
IDL = (
    "Mood.idl",
    """
// how it feels << how it looks
#include "std_msgs/msg/Header.idl"
module my_msgs { module msg {
  @verbatim (language="comment", text="a << b")
  struct Mood { std_msgs::msg::Header header; double joy; sequence<float, 8> history; };
}; };
""",
)


def refused(*definitions):
    with pytest.raises(DefinitionError) as caught:
        type_store(RosRelease.LATEST, definitions)
    return str(caught.value)


def a_stream(**more):
    return Stream("mood", "robot/mood", Encoding.CDR, type="my_msgs/msg/Mood", **more)


def test_unknown_types_are_findings_of_the_policy():
    known = Stream("imu", "robot/imu", Encoding.CDR, type="sensor_msgs/msg/Imu")
    findings = type_findings(Policy("lab", "robot", (), (known, a_stream())))
    assert [(finding.field, finding.value) for finding in findings] == [("spec.streams[1].type", "my_msgs/msg/Mood")]


@pytest.mark.parametrize(
    ("release", "type_name", "field", "has"),
    [
        (RosRelease.HUMBLE, "sensor_msgs/msg/Range", "variance", False),
        (RosRelease.JAZZY, "sensor_msgs/msg/Range", "variance", True),
        (RosRelease.KILTED, "nav_msgs/msg/Goals", "goals", True),
        (RosRelease.LYRICAL, "nav_msgs/msg/Trajectory", "points", True),
    ],
)
def test_each_release_has_its_own_messages(release, type_name, field, has):
    assert (field in dict(type_store(release).fielddefs[type_name][1])) is has


def test_latest_has_the_newest_definition_of_every_message():
    latest = type_store()
    for release in RosRelease:
        assert type_store(release).fielddefs.keys() <= latest.fielddefs.keys()
    lyrical = type_store(RosRelease.LYRICAL)
    assert all(latest.fielddefs[name] == fields for name, fields in lyrical.fielddefs.items())


@pytest.mark.parametrize("definitions", [(MOOD, NOTE), (IDL,)])
def test_own_messages_are_known_only_to_their_policy(definitions):
    assert type_findings(Policy("lab", "robot", (), (a_stream(types="robot-types", definitions=definitions),))) == []
    assert not is_known("my_msgs/msg/Mood")


def test_an_installed_ros_folder_gives_the_same_types_as_a_config_map(tmp_path):
    package = tmp_path / "share/my_msgs"
    (package / "msg").mkdir(parents=True)
    for name, text in (MOOD, NOTE):
        (package / "msg" / name.split(".", 2)[2]).write_text(text)
    (package / "package.xml").write_text("<package/>")
    for folder in (package, tmp_path / "share"):
        assert is_known("my_msgs/msg/Mood", type_store(RosRelease.LATEST, of_folder(folder)))
    assert of_config_map({**dict((MOOD, NOTE)), "README": "types"}) == (MOOD, NOTE)


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("Mood.msg", "float64 joy", "Mood.msg: is not a type name; a .msg is named like my_msgs.msg.Mood.msg"),
        ("my_msgs.msg.Mood.msg", "float64 joy\nfloat64\n", "my_msgs.msg.Mood.msg: has a syntax error in line 2"),
        ("Mood.idl", "module a {\n  struct\n\n", "Mood.idl: has a syntax error in line 4"),
        ("my_msgs.msg.Mood.msg", "Note note", "my_msgs/msg/Mood contains my_msgs/msg/Note, which is not defined"),
        ("my_msgs.msg.Mood.msg", "Mood[] moods", "my_msgs/msg/Mood contains itself"),
        (
            "my_msgs.msg.Mood.msg",
            f"string[{MAX_ITEMS + 1}] s",
            "has 10001 fields and items of arrays, expected at most 10000",
        ),
        (
            "my_msgs.msg.Mood.msg",
            "string[1000000000] s",
            "has 1000000000 fields and items of arrays, expected at most 10000",
        ),
        (
            "Mood.idl",
            "module a { module msg { struct M { wstring w; }; }; };",
            "w is of type wstring; expected one of bool",
        ),
        ("Mood.idl", "module a { const long long N = 1 << 99999999999; };", "shifts a constant; write the number"),
        ("geometry_msgs.msg.Vector3.msg", "float32 x", "ros: latest: Type 'geometry_msgs/msg/Vector3' is already"),
    ],
)
def test_definitions_that_are_invalid_are_reported(name, text, expected):
    assert expected in refused((name, text))


def test_all_mistakes_are_reported_at_once():
    expected = refused(("Mood.msg", ""), ("a.msg.B.msg", "?"))
    assert "Mood.msg: " in expected
    assert "a.msg.B.msg: " in expected


def test_messages_nest_only_as_deep_as_samples_may():
    chain = [(f"my_msgs.msg.M{i}.msg", f"M{i + 1} m") for i in range(MAX_DEPTH + 5)]
    assert "levels of messages" in refused(*chain, (f"my_msgs.msg.M{MAX_DEPTH + 5}.msg", "bool b"))


def test_a_definition_that_is_given_twice_must_be_the_same():
    twice = ("share/my_msgs/msg/Note.msg", NOTE[1])
    assert is_known("my_msgs/msg/Note", type_store(RosRelease.LATEST, (NOTE, twice)))
    assert "again, differently" in refused(NOTE, (twice[0], "bool sad"))


def test_definitions_are_never_code(monkeypatch):
    """The library turns definitions into Python; nothing in them is executed."""
    planted: list[int] = []
    monkeypatch.setattr(sys, "planted", planted, raising=False)
    evil = '__import__("sys").planted.append(1)'
    for name, text in (
        ("my_msgs.msg.Mood.msg", f'string S={evil}\nstring t \'"""\n{evil}"""\'\nbool b'),
        (f'my_msgs.msg.Mood"""\n{evil}.msg', "bool b"),
        ("Mood.idl", f'module a {{ module msg {{ struct M {{ @default (value="{evil}") string s; }}; }}; }};'),
    ):
        try:
            type_store(RosRelease.LATEST, ((name, text),))
        except DefinitionError:
            continue
    assert planted == []
