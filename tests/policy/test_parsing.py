"""From a manifest to a policy: units, what absent fields are, and all findings at once."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.policy import parsing
from contextpolicy.policy.spec import Control, Force, Mode, SatisfiedBy, Scheduler, Shadow
from contextpolicy.policy.stream_spec import Clock, Encoding, RosRelease
from tests.planning.builders import a_body, a_context, a_policy, a_stream, a_task
from tests.policy.parsing import refused


def test_an_absent_field_has_the_documented_default():
    policy = parsing.parse(a_body(tasks=[a_task("slam")]))
    assert (policy.mode, policy.enforcement.scheduler, policy.enforcement.control) == (
        Mode.ENFORCE,
        Scheduler.CFS,
        Control.WEIGHT,
    )
    assert (policy.reserve, policy.enforcement.min_dwell, policy.fallback, policy.force) == (0, 0.0, None, None)
    task = policy.tasks[0]
    assert (task.container, task.priority, task.idle, task.min, task.max) == ("slam", 1.0, None, 10, None)
    assert task.satisfied_by is SatisfiedBy.ALL
    assert policy.reference == "lab/robot"


def test_a_field_of_the_group_outside_it_says_where_it_belongs():
    [(value, allowed)] = refused(control="Weight").values()
    assert value == "Weight"
    assert allowed.endswith("; did you mean enforcement.control?")


def test_fields_are_read_in_planning_units():
    policy = a_policy(
        reserve="300m",
        enforcement={"minDwell": "1.5s"},
        streams=[a_stream("imu", staleAfter="500ms", encoding="cbor")],
        tasks=[a_task("slam", min="0.1", max=2, needs={"cores": "1", "memory": "1Ki", "deadline": "50ms"})],
    )
    task = policy.tasks[0]
    assert (policy.reserve, policy.enforcement.min_dwell) == (300, 1.5)
    assert (policy.streams[0].stale_after, policy.streams[0].encoding) == (0.5, Encoding.CBOR)
    assert (task.min, task.max) == (100, 2000)
    assert (task.needs.cores, task.needs.memory, task.needs.deadline) == (1000, 1024, 0.05)


def test_a_ros_stream_names_its_message_release_and_clock():
    cdr = {"encoding": "cdr", "type": "sensor_msgs/msg/Range"}
    said, unsaid = a_policy(
        streams=[a_stream("range", ros="humble", types="robot-types", clock="Arrival", **cdr), a_stream("near", **cdr)],
        tasks=[a_task("slam")],
    ).streams
    assert (said.ros, said.types, said.clock) == (RosRelease.HUMBLE, "robot-types", Clock.ARRIVAL)
    assert (unsaid.ros, unsaid.types, unsaid.clock) == (RosRelease.LATEST, None, Clock.AUTO)


def test_ros_fields_are_refused_on_other_streams():
    findings = refused(
        streams=[a_stream("imu", ros="foxy", types="Robot Types", clock="sim"), a_stream("mic", ros="jazzy")]
    )
    assert findings["spec.streams[0].clock"] == ("sim", "one of Auto, Source, Arrival")
    assert findings["spec.streams[0].types"][0] == "Robot Types"
    assert findings["spec.streams[1].ros"] == (
        "jazzy",
        "encoding cdr, as other encodings have no message types",
    )


def test_a_selector_reads_labels_and_expressions():
    selector = {"matchLabels": {"app": "slam"}, "matchExpressions": [{"key": "tier", "operator": "Exists"}]}
    task = a_policy(tasks=[{"name": "slam", "selector": selector}]).tasks[0]
    assert task.selector is not None
    assert task.selector.matches({"app": "slam", "tier": "x"})
    assert not task.selector.matches({"app": "slam"})


@pytest.mark.parametrize(
    "until",
    [
        "2026-11-21T12:00:00Z",
        "2026-11-21T13:00:00+01:00",
        datetime(2026, 11, 21, 12, tzinfo=UTC),
        datetime(2026, 11, 21, 10, tzinfo=timezone(timedelta(hours=-2))),
    ],
)
def test_a_moment_is_unix_time(until):
    policy = a_policy(tasks=[a_task("slam")], contexts=[a_context("care")], force={"context": "care", "until": until})
    assert policy.force == Force("care", 1795262400.0)


def test_a_shadow_has_usual_values():
    policy = a_policy(tasks=[a_task("slam")], shadow={"of": "other"})
    assert policy.shadow == Shadow("other", tolerance=0.05, patience=5.0, health="robot/*/health")
    assert a_policy(tasks=[a_task("slam")]).shadow is None


def test_all_findings_come_at_once_in_one_readable_message():
    spec = {"mode": "On", "reserve": "lots", "tasks": [a_task("slam", priority=-1, activity=[{"when": "nowhere.x"}])]}
    with pytest.raises(PolicyError) as caught:
        parsing.parse(a_body(**spec))
    lines = str(caught.value).splitlines()
    assert lines[0] == "ContextPolicy lab/robot:"
    assert "  spec.mode: invalid value 'On': expected one of Enforce, DryRun, Paused" in lines
    assert len(lines) == 5
