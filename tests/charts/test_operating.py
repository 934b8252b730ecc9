"""The reference page of conditions knows every condition, reason, Event, alert and metric, and invents none."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import contextpolicy
from contextpolicy.errors import OrderError
from contextpolicy.policy.spec import Mode
from contextpolicy.telemetry import status
from tests.charts.conftest import CHART
from tests.charts.test_monitoring import EXPORTED, RULES
from tests.crds.schema import nodes, schema

GUIDE = (CHART.parents[1] / "docs" / "reference" / "conditions.md").read_text(encoding="utf-8")
PACKAGE = Path(contextpolicy.__file__).parent
SOURCES = [ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")]
EVENT_SOURCES = {"emit", "note", "on_problem", "_post"}
"""The methods whose second argument is an Event's reason."""
WORD = re.compile(r"[A-Z][A-Za-z]+")


def rows(heading):
    """The cells of the table under a heading; an empty first cell means the one above."""
    part = GUIDE.split(f"## {heading}\n")[1].split("\n## ")[0]
    found, last = [], ""
    for line in part.splitlines():
        if line.startswith("| "):
            cells = [cell.strip() for cell in line.strip("|").split(" | ")]
            last = cells[0] = cells[0].strip() or last
            found.append(cells)
    return [row for row in found[1:] if not set(row[0]) <= set("-|")]


def words(node):
    """The CamelCase words that an expression may be: its own, and those of a name defined at the top of a module."""
    for inner in ast.walk(node):
        if isinstance(inner, ast.Constant) and isinstance(inner.value, str) and WORD.fullmatch(inner.value):
            yield inner.value
        elif isinstance(inner, ast.Name) and inner.id in CONSTANTS:
            yield CONSTANTS[inner.id]


CONSTANTS = {
    target.id: node.value.value
    for tree in SOURCES
    for node in tree.body
    if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    for target in node.targets
    if isinstance(target, ast.Name) and WORD.fullmatch(node.value.value)
}


CALLS = [
    (node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", ""), node)
    for tree in SOURCES
    for node in ast.walk(tree)
    if isinstance(node, ast.Call)
]


def calls(*names):
    """Every call of a function or method of these names."""
    return [call for name, call in CALLS if name in names]


def reasons_of_conditions():
    """What a condition of each type may say: the words in whatever makes one, and in the functions' local names.

    Where nothing is enforced, `Applied` says why: the mode.
    """
    found = set()
    tree = ast.parse(Path(status.__file__).read_text(encoding="utf-8"))
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        local = {
            target.id: node.value
            for node in ast.walk(function)
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for call in (one for one in ast.walk(function) if isinstance(one, ast.Call)):
            if ast.unparse(call.func) == "ConditionFinding":
                for argument in call.args[1:3]:
                    names = [inner.id for inner in ast.walk(argument) if isinstance(inner, ast.Name)]
                    values = [argument, *(local[name] for name in names if name in local)]
                    found |= {(ast.literal_eval(call.args[0]), word) for value in values for word in words(value)}
    return found | {("Applied", mode.value) for mode in Mode if mode is not Mode.ENFORCE}


def events():
    """Every reason with which an Event is posted: arguments, and what is compared or assigned on the way."""
    found = set()
    for call in calls(*EVENT_SOURCES):
        if len(call.args) > 1:
            found |= set(words(call.args[1]))
    publisher = ast.parse((PACKAGE / "policies/status_publisher.py").read_text(encoding="utf-8"))
    for node in ast.walk(publisher):
        if isinstance(node, ast.Assign) and "reason" in ast.unparse(node.targets[0]):
            found |= set(words(node.value))
        if isinstance(node, ast.For) and "reason" in ast.unparse(node.target):
            found |= set(words(node.iter))
    return found


def test_every_condition_with_every_reason():
    reported = {(row[0], row[1]) for row in rows("Conditions")}
    assert reported == reasons_of_conditions()


def test_the_conditions_are_those_of_the_definition():
    description = dict(nodes(schema()))["status.conditions[].type"]["description"]
    assert {row[0] for row in rows("Conditions")} == set(WORD.findall(description))


def test_every_event():
    reported = {reason for row in rows("Events") for reason in row[0].split(", ")}
    assert reported == events()
    assert len(reported) > 10


def runbooks():
    """What to do about each alert, by the heading that its runbook_url leads to."""
    part = GUIDE.split("## Alerts\n")[1].split("\n## ")[0]
    return dict(re.findall(r"^### (\w+)\n\n(.*?)(?=\n### |\Z)", part, re.DOTALL | re.MULTILINE))


def test_every_alert():
    assert list(runbooks()) == list(RULES)
    for name, text in runbooks().items():
        assert text.startswith("Critical.") == (RULES[name]["labels"]["severity"] == "critical"), name


def test_every_metric():
    reported = {name for row in rows("Metrics") for name in row[0].split(", ")}
    assert reported == {re.sub(r"_(bucket|sum|count)$", "", series) for series in EXPORTED}


def test_every_refusal_reason_of_the_agent():
    refused = {word for call in calls(OrderError.__name__, "note") for word in words(call.args[0])} - events()
    security = (CHART.parents[1] / "docs" / "explanation" / "security.md").read_text(encoding="utf-8")
    table = security.split("| reason | meaning | what to do |\n|---|---|---|\n")[1].split("\n\n")[0]
    explained = {reason for row in table.splitlines() for reason in WORD.findall(row.split(" | ")[0])}
    assert explained >= refused
    assert len(refused) > 8


def test_every_problem_has_a_remedy():
    good = {
        "Working",
        "Valid",
        "Open",
        "Heard",
        "Met",
        "Found",
        "InForce",
        "DryRun",
        "Promoted",
        "Restored",
        "Scheduled",
    }
    for row in rows("Conditions"):
        assert bool(row[3]) or row[1] in good, row
    assert [row for row in rows("Metrics") if not row[-1]] == []
    assert all(runbooks().values())
