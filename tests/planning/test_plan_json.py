"""The one definition of a plan as JSON: all publishers of a plan use these fields, and they are documented."""

from __future__ import annotations

import json
import re

from contextpolicy.bus.plan_message import message
from contextpolicy.planning import plan_json as module
from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.planning.plan_json import plan_json
from contextpolicy.simulation import report
from tests.bus.messages import plan as a_message
from tests.cluster.builders import NODE
from tests.planning.builders import Story, a_policy, a_stream, a_task

POLICY = a_policy(
    streams=[a_stream("imu")],
    tasks=[a_task("slam", needs={"cores": 4}), a_task("speech")],
    enforcement={"minDwell": "100ms"},
)
CONTAINERS = (Container("lab/slam/slam", "slam", NODE), Container("lab/speech/speech", "speech", NODE))


def a_plan():
    return Story(POLICY, Placement({NODE: 2000}, CONTAINERS)).last


def documented():
    """The fields of the docstring's two tables: the plan's own, and what the bus adds."""
    fields = [re.findall(r"^([a-z]+)  +\S", part, re.MULTILINE) for part in module.__doc__.split("adds what only")]
    return [set(names) - {"field"} for names in fields]


def test_bus_and_report_say_the_same():
    own = plan_json(POLICY, a_plan())
    reported = message(POLICY, 17, a_plan(), CONTAINERS, [], {})
    assert {name: value for name, value in reported.items() if name in own} == own
    document = report.as_fields(POLICY, [a_plan()], timeline="demo")
    assert document == {"policy": "lab/robot", "timeline": "demo", "plans": [json.loads(json.dumps(own))]}


def test_every_field_is_documented_and_no_other():
    own, added = documented()
    assert own == plan_json(POLICY, a_plan()).keys()
    assert added == message(POLICY, 17, a_plan(), CONTAINERS, [], {}).keys() - own | {"edition", "trigger"}
    assert a_message().keys() <= own | added


def test_shortfalls_are_reported_with_their_task():
    reported = [{"task": "slam", "message": "needs 4 cores, but gets 1"}]
    assert plan_json(POLICY, a_plan())["shortfalls"] == reported
