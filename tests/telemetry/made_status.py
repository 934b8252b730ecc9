"""The status of a robot, checked against the definition."""

from __future__ import annotations

import json
from dataclasses import replace

import jsonschema

from contextpolicy.cluster.claims import Claim
from contextpolicy.telemetry.status import (
    StatusFacts,
    status,
)
from tests.crds.schema import schema, strict
from tests.planning.builders import START, Story, a_context, a_policy, a_stream, a_task

SCHEMA = strict(schema())["properties"]["status"]
NOW = START + 100


def made(story, *, previous=(), **facts):
    """The status, as the API server would store it."""
    placement = replace(story.planner.placement, absent=facts.pop("absent", frozenset()))
    claim = Claim(placement, facts.pop("conflicts", []), facts.pop("obstacles", {}))
    claim.realtime = facts.pop("realtime", [])
    claim.misnamed = facts.pop("misnamed", {})
    claim.shared = facts.pop("shared", {})
    claim.agents = facts.pop("agents", frozenset())
    content = status(story.planner, StatusFacts(3, 17, claim, **facts), previous, NOW)
    stored = {name: value for name, value in json.loads(json.dumps(content)).items() if value is not None}
    jsonschema.validate(stored, SCHEMA)
    return stored


def condition(content, kind):
    [found] = [one for one in content["conditions"] if one["type"] == kind]
    return found["status"], found["reason"], found["message"]


def a_robot(**spec):
    return a_policy(
        **{
            "streams": [a_stream("imu", staleAfter="1s")],
            "tasks": [a_task("slam"), a_task("speech")],
            "contexts": [a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}})],
            **spec,
        }
    )


def moving(**spec):
    story = Story(a_robot(**spec))
    story.sample("imu", at=1, speed=0.3)
    return story
