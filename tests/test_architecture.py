"""Rules about who may import what, as the packages' docstrings state them."""

from __future__ import annotations

import ast
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.patching import known, patched_on

ROOT = Path(__file__).parents[1]
OPERATOR = ROOT / "operator"
ROBOTKIT = ROOT / "modules" / "robotkit"
PACKAGE = OPERATOR / "contextpolicy"
PLANNING = sorted((PACKAGE / "planning").glob("**/*.py"))

IMPORTED_FROM = {
    OPERATOR: ["contextpolicy"],
    ROBOTKIT: ["robotkit"],
    ROOT: ["modules", "timelines", "charts", "tests"],
}
"""The folders on Python's path, and the packages in each."""

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


def sources(root, package):
    """The text of each module of a package, by the name under which it is imported."""
    for path in (root / package).glob("**/*.py"):
        name = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
        yield name, path.read_text(encoding="utf-8")


def modules_imported(source, modules):
    """Those of the modules that a source imports, also inside functions and for types only."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from {alias.name for alias in node.names} & modules
        elif isinstance(node, ast.ImportFrom):
            yield from {f"{node.module}.{alias.name}" for alias in node.names} & modules or {node.module} & modules


def cycle(texts):
    """The names of modules of which each imports its neighbour, the first one again as the last; or nothing."""
    imported = {name: set(modules_imported(text, texts.keys())) for name, text in texts.items()}
    try:
        TopologicalSorter(imported).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def importers_of(package, texts):
    """The names of the modules that import a package."""
    return {name for name, text in texts if package in {other.partition(".")[0] for other in imports(ast.parse(text))}}


@pytest.mark.parametrize("path", PLANNING, ids=lambda path: path.name)
def test_planning_is_pure(path):
    assert impurities(path.read_text(encoding="utf-8"), path.name) == []


def test_there_is_something_to_check():
    assert len(PLANNING) > 15


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


TEXTS = {name: text for root, packages in IMPORTED_FROM.items() for p in packages for name, text in sources(root, p)}


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


def test_every_import_says_from_where():
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


def test_no_two_modules_share_a_name():
    names = [path.stem for path in PACKAGE.glob("**/*.py") if path.parent.name != "commands"]
    assert [name for name, count in Counter(names).items() if count > 1] == ["__init__"]


def test_no_two_public_classes_share_a_name():
    """A reader who searches for a class finds one."""
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.glob("**/*.py"))
    classes = (node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))
    assert [name for name, count in Counter(classes).items() if count > 1 and not name.startswith("_")] == []


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


def test_only_the_handlers_and_what_starts_them_import_kopf():
    importers = importers_of("kopf", sources(OPERATOR, "contextpolicy"))
    assert {name.rpartition(".")[2] for name in importers} == {"kopf_handlers", "kopf_thread", "run"}


def test_the_operator_folder_cannot_shadow_pythons_operator_module():
    assert not (OPERATOR / "__init__.py").exists()
    assert list(OPERATOR.glob("*.py")) == []


NAMES = known(*(ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.glob("**/*.py")))


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("**/*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_collaborators_come_through_constructors(path):
    assert patched_on(path.read_text(encoding="utf-8"), NAMES) == []


@pytest.mark.parametrize(
    ("planted", "found"),
    [
        ("runner.on_change = lambda: None", ["runner.on_change"]),
        ("made.signer, made.may_act = signer, lambda: True", ["made.may_act"]),
        ("def wake(): pass\nself.watch.on_refused = wake", ["self.watch.on_refused"]),
        ("class A:\n    def settle(self): pass\npromoter.on_change = self.policies.settle", ["promoter.on_change"]),
        ("x.board = partial(show, 1)", ["x.board"]),
        ("self.on_change: Callable[[], None] = lambda: None", ["self.on_change"]),
        ("self._on_change: Callable[[], None] = on_change", []),
        ("self._on_change = on_change", []),
        ("entry.runner = PolicyRunner(policy)", []),
        ("class A:\n    @property\n    def body(self): pass\nentry.body = body", []),
        ("def wire(watch, on_change):\n    watch.on_refused = on_change", ["watch.on_refused"]),
        ("def wire(watch, wake: Callable[[], None]):\n    watch.refused = wake", ["watch.refused"]),
        ("wake = lambda: None\nwatch.refused = wake", ["watch.refused"]),
        ("async def wake(): pass\nwatch.refused = wake", ["watch.refused"]),
        ("watch.on_refused = Waker()", ["watch.on_refused"]),
        ("watch.on_refused = None", ["watch.on_refused"]),
        ("for watch.on_refused in wakers: pass", ["watch.on_refused"]),
        ("watch.on_refused, *others = wakers", ["watch.on_refused"]),
        ("[watch.refused, b] = [lambda: None, 2]", ["watch.refused"]),
        ("watch.refused = wake or (lambda: None)", ["watch.refused"]),
        ("watch.refused = (lambda: None) if quiet else None", ["watch.refused"]),
        ("watch.handlers['refused'] = lambda: None", ["watch.handlers['refused']"]),
        ("setattr(watch, 'refused', x)", ["setattr(watch, 'refused', x)"]),
        ("object.__setattr__(self.watch, 'refused', x)", ["object.__setattr__(self.watch, 'refused', x)"]),
        ("class A:\n    def __init__(self, refused: Callable[[], None]): pass\nwatch.refused = x", ["watch.refused"]),
        ("class A:\n    def f(self):\n        self._refused: Callable[[], None] = x\nb._refused = y", ["b._refused"]),
        ("vars(watch).update(refused=x)", ["vars(watch)"]),
        ("vars(self.watch)['refused'] = x", ["vars(self.watch)"]),
        ("watch.__dict__.update(refused=x)", ["watch.__dict__"]),
        ("watch.__dict__['refused'] = x", ["watch.__dict__"]),
        ("class A:\n    def listen(self, wake: Callable[[], None]):\n        self._wake = wake", ["self._wake"]),
        ("class A:\n    def f(self, x: Callable[[], None]):\n        'Wakes.'\n        self._wake = x", ["self._wake"]),
        ("class A:\n    def listen(self, *, wake: 'Callable[[], None]'): self._a, self._b = 1, wake", ["self._b"]),
        ("self.on_change = lambda: None", ["self.on_change"]),
        ("self.on_change: Optional[Callable[[], None]] = None", ["self.on_change"]),
        ("self.on_change: None | Callable[[], None] = None", ["self.on_change"]),
        ("self.on_change: 'Callable[[], None] | None' = None", ["self.on_change"]),
        ("self.on_change: typing.Callable[[], None]", ["self.on_change"]),
        ("Listener: TypeAlias = 'Callable[[], None]'\nself.on_change: Listener = x", ["self.on_change"]),
        ("Listener = Callable[[], None]\nclass A:\n    on_change: Listener", ["on_change"]),
        ("class A:\n    on_change: Callable[[], None]", ["on_change"]),
        ("class A:\n    on_change = lambda: None", ["on_change"]),
        ("@dataclass\nclass A:\n    on_change: Callable[[], None] = lambda: None", ["on_change"]),
        ("@dataclass(frozen=True)\nclass A:\n    on_change: Callable[[], None] = lambda: None", ["on_change"]),
        ("@dataclass\nclass A:\n    on_change: Callable[[], None] | None = None", ["on_change"]),
        ("@dataclass\nclass A:\n    run: Callable[[], None]\nself.row.run = x", ["self.row.run"]),
        ("@dataclass(frozen=True)\nclass A:\n    run: Callable[[], None] | None = None\nself.publisher.run = 1", []),
        ("@dataclass\nclass A:\n    run: Callable[[], None]", []),
        ("class A:\n    _run: Callable[[], None]", []),
        ("self.handlers: dict[str, Callable[[], None]] = {}", []),
        ("def wire(watch, on_change): self.on_change = on_change", []),
        ("self._handlers['refused'] = lambda: None", []),
        ("class A:\n    def body(self): pass\nclass B:\n    body: str\nentry.text = b.body", []),
        ("object.__setattr__(self, 'refused', x)", []),
        ("vars(self).update(refused=x)\nprint(vars(watch)['refused'])", []),
        ("class A:\n    def __init__(self, wake: Callable[[], None]): self._wake = wake", []),
        ("class A:\n    def start(self, wake: Callable[[], None]):\n        self._wake = wake\n        wake()", []),
        ("class A:\n    def take(self, wake: float): self._wake = wake\n    def wake(self): pass", []),
        ("class A:\n    def f(self, wake: Callable[[], None]): self._a = other.wake", []),
    ],
)
def test_a_callable_that_is_patched_on_is_found(planted, found):
    assert patched_on(planted, known()) == found
