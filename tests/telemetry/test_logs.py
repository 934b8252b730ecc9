"""The log of operator and agent, as a person and as a collector reads it."""

from __future__ import annotations

import json
import logging

import kopf
import pytest

from contextpolicy.telemetry import logs
from contextpolicy.telemetry.logs import log_plan
from tests.planning.builders import Story, a_policy, a_task

NAME = "contextpolicy.policies.status_publisher"


@pytest.fixture
def written(capsys):
    """What is on stderr after `log_format` was configured and a record was logged."""
    root = logging.getLogger()
    before, level = root.handlers[:], root.level

    def logged(log_format, log):
        root.handlers[:] = []
        logs.configure(log_format, "info")
        log()
        return capsys.readouterr().err

    yield logged
    root.handlers[:] = before
    root.setLevel(level)


def test_text_lines_have_the_whole_name_of_the_logger(written):
    line = written("text", lambda: logging.getLogger(NAME).warning("slow: %s", "bus"))
    assert line.endswith(f"WARNING {NAME}: slow: bus\n")


def test_control_characters_do_not_break_the_line(written):
    quoted = "b > 1\n[2026-11-25 21:00:00,000] ERROR forged: \x1b[31mfire\r"
    line = written("text", lambda: logging.getLogger(NAME).warning("cause: %s", quoted))
    assert line.endswith("cause: b > 1 [2026-11-25 21:00:00,000] ERROR forged: \N{REPLACEMENT CHARACTER}[31mfire\n")
    assert line.count("\n") == 1


def test_json_lines_have_the_whole_name_of_the_logger(written):
    line = json.loads(written("json", lambda: logging.getLogger(NAME).warning("slow: %s", "bus")))
    assert line.pop("timestamp")
    assert line == {"severity": "WARNING", "logger": NAME, "message": "slow: bus"}


def test_json_lines_have_the_parts_of_a_plan_as_fields(written):
    policy = a_policy(tasks=[a_task("slam")])
    plan = Story(policy).plans[-1]
    line = json.loads(written("json", lambda: log_plan(policy, plan)))
    assert (line["policy"], line["sequence"], line["shares"]) == ("lab/robot", plan.sequence, {"slam": "1"})


def test_json_lines_have_no_objects_of_kopf(written):
    settings = kopf.OperatorSettings()
    settings.posting.enabled = False
    extra = {"k8s_ref": {"name": "delivery"}, "k8s_skip": True, "settings": settings}
    line = json.loads(written("json", lambda: logging.getLogger("kopf.objects").warning("slow", extra=extra)))
    assert line.keys() == {"timestamp", "severity", "logger", "message"}
