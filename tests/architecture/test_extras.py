"""Who works on the operator alone installs the extra `dev`, without the gigabyte that the robot's modules need."""

from __future__ import annotations

import ast
import tomllib
from importlib.metadata import packages_distributions
from importlib.util import find_spec

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.architecture.source_code import ROOT, TEXTS, imports, modules_imported

NOT_THE_OPERATORS = (
    "modules",
    "timelines",
    "tests.modules",
    "tests.timelines",
    "tests.bench",
    "tests.e2e",
    "tests.heavy",
)
READ_WHEN_NEEDED = {"robotkit.readings"}
"""Modules that import such a package in the one function that needs it."""


def distributions(extra):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {canonicalize_name(Requirement(text).name) for text in project["optional-dependencies"][extra]}


def packages(names):
    """What the distributions are imported as."""
    found = packages_distributions().items()
    return {package for package, providers in found if names & {canonicalize_name(provider) for provider in providers}}


def roots(text):
    return {name.partition(".")[0] for name in imports(ast.parse(text))}


def with_all_that_they_import(names):
    reached, waiting = set(), list(names)
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += modules_imported(TEXTS[name], TEXTS.keys())
    return reached


@pytest.mark.skipif(find_spec("cv2") is None, reason="the extra `modules` is not installed")
def test_the_operator_and_its_tests_import_nothing_of_the_extra_modules():
    own = [name for name in TEXTS if not f"{name}.".startswith(tuple(f"{other}." for other in NOT_THE_OPERATORS))]
    heavy = packages(distributions("modules"))
    assert {"cv2", "gtsam", "jax", "foxglove"} <= heavy
    imported = {name: roots(TEXTS[name]) & heavy for name in with_all_that_they_import(own) - READ_WHEN_NEEDED}
    assert {name: packages for name, packages in imported.items() if packages} == {}
