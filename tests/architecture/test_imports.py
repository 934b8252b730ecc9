"""Imports form no cycle and say from where, and some packages are imported by few."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter

import pytest

from tests.architecture.source_code import OPERATOR, ROOT, TEXTS, importers_of, modules_imported, sources


def cycle(texts):
    """The names of modules of which each imports its neighbour, the first one again as the last; or nothing."""
    imported = {name: set(modules_imported(text, texts.keys())) for name, text in texts.items()}
    try:
        TopologicalSorter(imported).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_modules_import_each_other_in_a_cycle():
    assert cycle(TEXTS) == []
    assert {"contextpolicy.planning.planner", "robotkit.runner", "modules.slam.task", "tests.node"} <= TEXTS.keys()


@pytest.mark.parametrize(
    ("planted", "found"),
    [
        ("import bus.fleet", True),
        ("from bus.fleet import Fleet", True),
        ("from bus import fleet", True),
        ("if TYPE_CHECKING:\n    from bus.fleet import Fleet", True),
        ("def f():\n    from bus.fleet import Fleet", True),
        ("from bus import Session", False),
        ("import bus.fleeting", False),
    ],
)
def test_a_planted_cycle_is_found(planted, found):
    texts = {"bus": "", "bus.roles": planted, "bus.session": "from bus import roles", "bus.fleet": "import bus.session"}
    assert set(cycle(texts)) == ({"bus.roles", "bus.session", "bus.fleet"} if found else set())


def relative_imports(source):
    """Imports whose text does not say from where: the rules here would not see them."""
    nodes = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom))
    return [ast.unparse(node) for node in nodes if node.level]


def test_imports_are_absolute():
    assert {name: found for name, text in TEXTS.items() if (found := relative_imports(text))} == {}


@pytest.mark.parametrize(
    ("planted", "found"),
    [
        ("from . import binder", ["from . import binder"]),
        ("from .. import app", ["from .. import app"]),
        ("from ..app import wiring", ["from ..app import wiring"]),
        ("def f():\n    from .binder import Binder", ["from .binder import Binder"]),
        ("from contextpolicy.app import wiring\nimport math", []),
    ],
)
def test_a_planted_relative_import_is_found(planted, found):
    assert relative_imports(planted) == found


def test_modules_import_nothing_from_timelines():
    """A module's image has the module and robotkit, and no timelines."""
    assert importers_of("timelines", sources(ROOT, "modules")) == set()


@pytest.mark.parametrize(
    ("planted", "found"),
    [
        ("import timelines", True),
        ("from timelines.datasets import speech", True),
        ("def f():\n    import timelines.datasets.speech as speech", True),
        ("import timelines_of_a_robot\nfrom modules.timelines import read", False),
    ],
)
def test_a_planted_import_of_timelines_is_found(planted, found):
    assert importers_of("timelines", [("modules.planted", planted)]) == ({"modules.planted"} if found else set())


def test_only_the_handlers_and_what_starts_them_import_kopf():
    importers = importers_of("kopf", sources(OPERATOR, "contextpolicy"))
    assert {name.rpartition(".")[2] for name in importers} == {"kopf_handlers", "kopf_reading", "kopf_thread"}
