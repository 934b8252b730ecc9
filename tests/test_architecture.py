"""Rules about who may import what, as the packages' docstrings state them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

OPERATOR = Path(__file__).parents[1] / "operator"
PACKAGE = OPERATOR / "contextpolicy"
PLANNING = sorted((PACKAGE / "planning").glob("**/*.py"))

PURE = {
    *("__future__", "collections", "dataclasses", "decimal", "enum", "fractions", "functools", "heapq", "itertools"),
    *("logging", "math", "operator", "re", "typing"),
    *("cel", "contextpolicy.errors", "contextpolicy.planning"),
}
"""What planning may import: no clock, no I/O, no threads, no Kubernetes, no Zenoh."""

ALSO = {
    "observable.py": {"reactivex"},
    "fields.py": {"datetime"},  # reads a moment that a person wrote, never the clock
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


def imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or "." * node.level
            yield from (f"{node.module}.{alias.name}" for alias in node.names if node.module == "contextpolicy")


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


def importers_of(module, files):
    return {
        path.name
        for path in files
        if any(name.partition(".")[0] == module for name in imports(ast.parse(path.read_text(encoding="utf-8"))))
    }


@pytest.mark.parametrize("path", PLANNING, ids=lambda path: path.name)
def test_planning_is_pure(path):
    assert impurities(path.read_text(encoding="utf-8"), path.name) == []


def test_there_is_something_to_check():
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
        ("from contextpolicy import controller", ["contextpolicy", "contextpolicy.controller"]),
        ("from . import shares", ["."]),
        ("import contextpolicy_extra", ["contextpolicy_extra"]),
        ("x = datetime.now()", ["datetime.now"]),
        ("open('/etc/hosts')", ["open"]),
        ("import math\nfrom contextpolicy.planning.plan import Plan", []),
    ],
)
def test_a_planted_violation_is_found(planted, found):
    assert impurities(planted, "shares.py") == found


def test_only_handlers_import_kopf():
    assert importers_of("kopf", PACKAGE.glob("**/*.py")) <= {"handlers.py", "operation.py"}


def test_the_operator_folder_cannot_shadow_pythons_operator_module():
    assert not (OPERATOR / "__init__.py").exists()
    assert list(OPERATOR.glob("*.py")) == []
