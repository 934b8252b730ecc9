"""Components take their collaborators in their constructors and call them by named methods."""

from __future__ import annotations

import ast

import pytest

from tests.architecture.constructors import aliases_of, bare_callbacks, protocols_of
from tests.architecture.source_code import PACKAGE

ANSWERING_ANYTHING = {"Function(run)", "_Plain(read)", "_Action(action)"}
"""A row's function and a reader, whose values are used, and what a scheduler runs once: reactivex has that type."""
PROTOCOLS = protocols_of(*(ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.glob("**/*.py")))
ALIASES = aliases_of(*(path.read_text(encoding="utf-8") for path in PACKAGE.glob("**/*.py")))


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("**/*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_components_call_their_collaborators_by_named_methods(path):
    assert set(bare_callbacks(path.read_text(encoding="utf-8"), ALIASES, PROTOCOLS)) - ANSWERING_ANYTHING == set()


@pytest.mark.parametrize(
    ("parameter", "is_found"),
    [
        ("wake: Callable[[], None]", True),
        ("wake: Callable[[str, float], object]", True),
        ("restart: Callable[[], NoReturn]", True),
        ("wake: 'Callable[[], None]'", True),
        ("wake: Callable[[], None] | None = None", True),
        ("wake: Optional[Callable[[], None]] = None", True),
        ("wake: typing.Callable[[], None] = lambda: None", True),
        ("*, wake: Callable[[], None]", True),
        ("wake: Tap", True),
        ("listener: WakeListener | None", True),
        ("listener: WakeListener = QUIET", True),
        ("*, listener: WakeListener = QUIET", True),
        ("listener: WakeListener", False),
        ("clock: Callable[[], float] = time.monotonic", False),
        ("wait: Callable[[float], object]", False),
        ("make: Callable[[Activity], Initiative]", False),
        ("is_due: Callable[[Plan], bool]", False),
        ("signer: Signer | None = None", True),
        ("observer: Observer | None = None", True),
        ("observer: Optional[Observer]", True),
        ("actuator: 'Actuator | None'", True),
        ("signer: Key | None = None", False),
        ("actuators: Mapping[Mode, Actuator] = NONE", False),
        ("handlers: Mapping[str, Callable[[], None]]", True),
        ("wakers: Sequence[Callable[[], None]] = ()", True),
        ("wake: Callable[..., Any]", True),
        ("clocks: Sequence[Callable[[], float]]", False),
    ],
)
def test_a_constructor_that_takes_a_bare_callback_is_found(parameter, is_found):
    aliases = aliases_of("Tap: TypeAlias = 'Callable[[float], object]'")
    source = f"class A:\n    def __init__(self, {parameter}): pass"
    assert bool(bare_callbacks(source, aliases, {"Signer", "Observer", "Actuator"})) is is_found


def test_a_dataclass_that_takes_a_bare_callback_is_found():
    source = "@dataclass\nclass A:\n    name: str\n    wake: Callable[[], None]"
    assert bare_callbacks(source, {}) == ["A(wake)"]
