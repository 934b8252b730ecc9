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

`errors` is the one file that everybody imports; `cli` and `__main__` are the doors to the commands."""
ROOMS = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}
DOORS = {("cli", "commands"), ("__main__", "cli")}
"""The imports within a layer that are allowed."""


def room_of(path):
    inside = path.relative_to(PACKAGE).parts
    return inside[0].removesuffix(".py")


def rooms_imported(source):
    """The rooms of the package that a module imports, also inside functions."""
    names = (name.split(".") for name in imports(ast.parse(source)))
    return {parts[1] for parts in names if parts[0] == "contextpolicy" and len(parts) > 1}


def trespasses(room, source):
    """Every import of a room that does not stand in a layer before the importer's own."""
    return sorted(
        other for other in rooms_imported(source) - {room} if ROOMS[other] >= ROOMS[room] and (room, other) not in DOORS
    )


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("**/*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_up_the_layers_only(path):
    if path.name != "__init__.py" or path.parent != PACKAGE:
        assert trespasses(room_of(path), path.read_text(encoding="utf-8")) == []


def test_every_room_has_its_layer():
    rooms = {room_of(path) for path in PACKAGE.glob("**/*.py")} - {"__init__"}
    assert rooms == ROOMS.keys()


@pytest.mark.parametrize(
    ("room", "planted", "found"),
    [
        ("planning", "from contextpolicy.cluster.pods import Cpu", ["cluster"]),
        ("policy", "def f():\n    from contextpolicy.planning import plan", ["planning"]),
        ("bus", "from contextpolicy.actuators.order import Order", ["actuators"]),
        ("bus", "from contextpolicy import policies", ["policies"]),
        ("bus", "from contextpolicy.cluster.claims import Claim", []),
    ],
)
def test_a_planted_trespass_is_found(room, planted, found):
    assert trespasses(room, planted) == found
