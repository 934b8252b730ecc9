"""Planning has no clock, no I/O, no threads: all that it knows are its arguments."""

from __future__ import annotations

import ast

import pytest

from tests.architecture.source_code import PACKAGE, imports

PLANNING = sorted((PACKAGE / "planning").glob("**/*.py"))

PURE = {
    *(
        "__future__",
        "bisect",
        "collections",
        "dataclasses",
        "decimal",
        "enum",
        "fractions",
        "functools",
        "heapq",
        "itertools",
    ),
    *("logging", "math", "operator", "re", "types", "typing"),
    *("cel", "contextpolicy.errors", "contextpolicy.policy", "contextpolicy.planning"),
}
"""What planning may import: no clock, no I/O, no threads, no Kubernetes, no Zenoh."""

ALSO = {
    "observable.py": {"reactivex"},
}
FORBIDDEN_CALLS = {
    "now",
    "utcnow",
    "today",
    "time",
    "monotonic",
    "perf_counter",
    "open",
    "exec",
    "eval",
    "print",
    "input",
}
NOT_THE_CLOCK = {"self._now", "self._scheduler.now"}
"""The scheduler's time, which is an argument."""


def calls(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            if name.rpartition(".")[2] in FORBIDDEN_CALLS and name not in NOT_THE_CLOCK:
                yield name


def impurities(source, file_name):
    """Every import and call in a planning module that is not allowed there."""
    tree = ast.parse(source)
    allowed = PURE | ALSO.get(file_name, set())
    bad = [name for name in imports(tree) if not any(name == root or name.startswith(f"{root}.") for root in allowed)]
    return bad + list(calls(tree))


@pytest.mark.parametrize("path", PLANNING, ids=lambda path: path.name)
def test_planning_is_pure(path):
    assert impurities(path.read_text(encoding="utf-8"), path.name) == []


def test_planning_modules_are_found():
    assert len(PLANNING) > 15


@pytest.mark.parametrize(
    ("planted", "found"),
    [
        ("import time", ["time"]),
        ("import os.path", ["os.path"]),
        ("from time import monotonic", ["time"]),
        ("from datetime import datetime", ["datetime"]),
        ("def f():\n    import socket", ["socket"]),
        ("from threading import Lock", ["threading"]),
        ("import reactivex", ["reactivex"]),
        ("from contextpolicy.streams import timeline", ["contextpolicy.streams"]),
        ("from contextpolicy import policies", ["contextpolicy", "contextpolicy.policies"]),
        ("from . import shares", ["."]),
        ("import contextpolicy_extra", ["contextpolicy_extra"]),
        ("x = datetime.now()", ["datetime.now"]),
        ("open('/etc/hosts')", ["open"]),
        ("import math\nfrom contextpolicy.planning.allocation.plan import Plan", []),
    ],
)
def test_a_planted_violation_is_found(planted, found):
    assert impurities(planted, "shares.py") == found
