"""Rules about which package of the operator may import which, as the packages' docstrings state them."""

from __future__ import annotations

import ast

import pytest

from tests.architecture.source_code import PACKAGE, imports

LAYERS = (
    ("errors",),
    ("policy",),
    ("planning",),
    ("cluster", "streams", "explain", "shadow"),
    ("actuators", "bus", "simulation", "recorder"),
    ("telemetry", "live", "agent"),
    ("policies",),
    ("app",),
    ("commands", "cli", "__main__"),
)
"""Who may import whom: a package imports packages of the lines before its own, never of its own line or of later ones.

`errors` is the one file that everybody imports; `cli` and `__main__` are the entry points of the commands."""
LEVELS = {package: level for level, packages in enumerate(LAYERS) for package in packages}
ALLOWED = {("cli", "commands"), ("__main__", "cli")}
"""The imports within a layer that are allowed."""


def package_of(path):
    inside = path.relative_to(PACKAGE).parts
    return inside[0].removesuffix(".py")


def packages_imported(source):
    """The packages that a module imports, also inside functions."""
    names = (name.split(".") for name in imports(ast.parse(source)))
    return {parts[1] for parts in names if parts[0] == "contextpolicy" and len(parts) > 1}


def violations(package, source):
    """Every import of a package that does not stand in a layer before the importer's own."""
    others = packages_imported(source) - {package}
    return sorted(other for other in others if LEVELS[other] >= LEVELS[package] and (package, other) not in ALLOWED)


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("**/*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_come_only_from_lower_layers(path):
    if path.name != "__init__.py" or path.parent != PACKAGE:
        assert violations(package_of(path), path.read_text(encoding="utf-8")) == []


def test_every_package_has_a_layer():
    packages = {package_of(path) for path in PACKAGE.glob("**/*.py")} - {"__init__"}
    assert packages == LEVELS.keys()


@pytest.mark.parametrize(
    ("package", "planted", "found"),
    [
        ("planning", "from contextpolicy.cluster.pods import Cpu", ["cluster"]),
        ("policy", "def f():\n    from contextpolicy.planning import plan", ["planning"]),
        ("bus", "from contextpolicy.actuators.order import Order", ["actuators"]),
        ("bus", "from contextpolicy import policies", ["policies"]),
        ("bus", "from contextpolicy.cluster.claims import Claim", []),
    ],
)
def test_planted_layer_violation_is_found(package, planted, found):
    assert violations(package, planted) == found
