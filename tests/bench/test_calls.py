from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.bench.calls import GOAL

CHANGES = 4
SAME = 5
"""Calls: whether a context begins or ends makes a difference of two."""


@pytest.fixture(scope="module")
def measured():
    command = [sys.executable, "-m", "tests.bench.calls", "--output", "json", "--changes", str(CHANGES)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout)


def test_each_figure_adds_to_the_one_before(measured):
    first, last, idle = (measured[figure]["calls"] for figure in ("first", "last", "idle"))
    assert 0 < first < last <= idle  # equal where the loop got no processor after it had published


def test_the_operators_own_calls_are_a_part_of_all(measured):
    first = measured["first"]
    assert 0 < first["own"] < first["calls"]
    assert 0 < first["own_files"] < first["files"] == len(measured["by_file"])
    assert sum(measured["by_file"].values()) == first["calls"]


def test_changes_take_the_same_number_of_calls(measured):
    assert len(measured["changes"]) == CHANGES
    # A busy machine may let other work come between, so some may take more.
    fewest, next_to = sorted(measured["changes"])[:2]
    assert next_to - fewest <= SAME


def test_a_change_takes_no_more_calls_than_the_goal(measured):
    assert min(measured["changes"]) <= GOAL
