"""The table of functions is true: what it says of each is what happens when an expression calls it."""

from __future__ import annotations

import ast
from contextlib import suppress
from datetime import datetime, timedelta
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.policy import cel_functions, cel_mistakes
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.cel_functions import FUNCTIONS, LIBRARY, NAMES, OWN, RESERVED, Macro
from contextpolicy.policy.cel_kinds import CallCost, CallForm, ValueKind
from contextpolicy.policy.validation.cel_types import mistakes
from contextpolicy.policy.validation.shapes import ANY, of_example, of_kind

SAMPLE = {"gyro": [3.0, 4.0], "speed": 0.5, "frame": "imu_link", "time": "2026-11-21T12:00:00Z"}
SHAPES = {"imu": of_example(SAMPLE, "its example")}
LITERALS = {
    ValueKind.ANY: ["imu.speed"],
    ValueKind.BOOL: ["true"],
    ValueKind.NUMBER: ["2.5", "2"],
    ValueKind.TEXT: ["'imu'", "'2026-11-21T12:00:00Z'", "'3s'", "'3'"],
    ValueKind.PATTERN: ["'^imu'"],
    ValueKind.BYTES: ["b'imu'"],
    ValueKind.NULL: ["null"],
    ValueKind.TIME: ["timestamp('2026-11-21T12:00:00Z')"],
    ValueKind.DURATION: ["duration('3s')"],
    ValueKind.LIST: ["[3.0, 4.0]", "[[3.0, 4.0], [5.0, 6.0]]"],
    ValueKind.MAP: ["{'x': 3.0, 'y': 4.0}"],
}
TYPES: dict[ValueKind, Any] = {
    ValueKind.ANY: object,
    ValueKind.BOOL: bool,
    ValueKind.NUMBER: (int, float),
    ValueKind.WHOLE: int,
    ValueKind.DOUBLE: float,
    ValueKind.TEXT: str,
    ValueKind.BYTES: bytes,
    ValueKind.TIME: datetime,
    ValueKind.DURATION: timedelta,
}
PACKAGE = Path(cel_functions.__file__).parents[1]
READERS = [
    *sorted(
        {*(PACKAGE / "policy").glob("cel*.py")}
        - {PACKAGE / "policy" / f"cel_{name}.py" for name in ("functions", "kinds")}
    ),
    *(PACKAGE / "policy/validation").glob("cel*.py"),
    *(PACKAGE / "planning/conditions").glob("*.py"),
]
"""What knows functions from the table alone."""


def by_name(functions):
    return [pytest.param(function, id=function.name) for function in functions]


CALLED = by_name(function for function in FUNCTIONS.values() if function.cost is not CallCost.ASK)


def evaluate(source):
    """The value on the sample, one second after it came."""
    scope = Scope()
    expression = scope.compile(source)
    scope.bind("imu", SAMPLE, now=0.0)
    scope.instant.now = 1.0
    return expression.evaluate(scope)


def values(calls):
    """Of those calls that have one."""
    found = []
    for call in calls:
        with suppress(ValueError, ExpressionError):
            found.append(evaluate(call))
    return found


def refused(calls):
    return [call for call in calls if mistakes(call, ANY, SHAPES)]


def forms(function):
    return {CallForm.CALL, CallForm.METHOD} if function.form is CallForm.EITHER else {function.form}


def calls(function, form, *kinds):
    """Every call with arguments of these kinds."""
    for first, *rest in product(*(LITERALS[kind] for kind in kinds)):
        called = f"{function.name}({', '.join((first, *rest))})"
        yield called if form is CallForm.CALL else f"{first}.{function.name}({', '.join(rest)})"


def calls_with(function, form, place, kind):
    """Calls with that kind of argument at that place, and beside it what the function takes there."""
    for more in range(1 + function.variadic):
        around = list(function.kinds(len(function.takes) + more))
        around[place] = (kind,)
        for kinds in product(*around):
            yield from calls(function, form, *kinds)


@pytest.mark.parametrize("function", by_name(FUNCTIONS.values()))
def test_its_example_is_right_and_works(function):
    assert not Expression(function.example).unknown_functions
    assert mistakes(function.example, ANY, SHAPES) == []
    assert evaluate(function.example) is not None


@pytest.mark.parametrize("function", CALLED)
def test_it_takes_each_kind_and_returns_what_it_says(function):
    for form, (place, kinds) in product(forms(function), enumerate(function.takes)):
        for kind in kinds:
            found = list(calls_with(function, form, place, kind))
            assert any(isinstance(value, TYPES[function.returns]) for value in values(found)), (form, kind)
            assert refused(call for call in found if not function.constant or values([call])) == []


@pytest.mark.parametrize("function", by_name(each for each in FUNCTIONS.values() if each.constant))
def test_an_invalid_constant_is_refused_with_a_valid_example(function):
    assert values([function.constant])
    assert refused([function.constant]) == []
    (reported,) = mistakes(f"{function.name}('imu')", ANY, SHAPES)
    assert function.constant in reported


@pytest.mark.parametrize("function", CALLED)
def test_arguments_of_another_type_are_refused(function):
    for form, (place, kinds) in product(forms(function), enumerate(function.takes)):
        taken = {*map(of_kind, kinds)}
        for kind in (kind for kind in LITERALS if ANY not in {of_kind(kind), *taken} and of_kind(kind) not in taken):
            found = list(calls_with(function, form, place, kind))
            assert function in OWN or values(found) == [], (form, kind)
            assert refused(found) == found


@pytest.mark.parametrize("function", CALLED)
def test_it_takes_no_other_number_of_arguments(function):
    kinds = [each[0] for each in function.takes]
    wrong = [kinds[:-1]] if len(kinds) > 1 else []
    wrong += [] if function.variadic else [[*kinds, kinds[-1]]]
    for form, counted in product(forms(function), wrong):
        found = list(calls(function, form, *counted))
        assert values(found) == []
        assert refused(found) == found


@pytest.mark.parametrize("function", CALLED)
def test_it_is_written_in_no_other_form(function):
    for form in {CallForm.CALL, CallForm.METHOD} - forms(function):
        found = list(calls(function, form, *(kinds[0] for kinds in function.takes)))
        assert values(found) == []
        assert refused(found) == found


@pytest.mark.parametrize("function", [each for each in CALLED if each.values[0].cost is CallCost.WALK])
def test_functions_that_copy_nothing_return_scalars(function):
    for form, (place, kinds) in product(forms(function), enumerate(function.takes)):
        for kind in kinds:
            found = values(calls_with(function, form, place, kind))
            assert [value for value in found if isinstance(value, list | dict | str | bytes)] == []


@pytest.mark.parametrize(("text", "points"), [("ü", 1), ("", 0), ("😀", 1), ("e\u0301", 2), ("日本", 2), ("imu", 3)])
def test_a_text_is_as_long_as_it_has_code_points(text, points):
    assert evaluate(f"size('{text}')") == evaluate(f"'{text}'.size()") == points


@pytest.mark.parametrize(("source", "size"), [("size(imu)", 4), ("imu.gyro.size()", 2), ("size(b'\\xc3\\xbc')", 2)])
def test_size_counts_bytes_items_and_entries(source, size):
    assert evaluate(source) == size


@pytest.mark.parametrize("macro", Macro)
def test_the_example_of_a_macro_is_right_and_works(macro):
    assert mistakes(macro.example, ANY, SHAPES) == []
    assert evaluate(macro.example) is not None
    assert macro.meaning


@pytest.mark.parametrize("macro", Macro)
def test_a_macro_walks_a_list(macro):
    source = f"imu.gyro.{macro}(g, g > 3.5)"
    assert not Expression(source).unknown_functions
    assert evaluate(source) == {Macro.ALL: False, Macro.MAP: [False, True], Macro.FILTER: [4.0]}.get(macro, True)


def test_names_are_unique():
    assert len(FUNCTIONS) + len(Macro) == len(LIBRARY) + len(OWN) + len(Macro) == len(NAMES)


def test_our_own_functions_are_not_stream_names():
    assert {function.name for function in OWN} <= {*RESERVED}


@pytest.mark.parametrize("path", READERS, ids=lambda path: path.name)
def test_no_other_file_names_a_function(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)} & NAMES == set()


def test_the_files_to_check_exist():
    assert {"cel.py", "cel_cost.py", "cel_types.py", "scope.py"} <= {path.name for path in READERS}


@pytest.mark.parametrize(
    ("name", "suggested"), [("sqr", "sqrt"), ("starts_with", "startsWith"), ("exist", "exists"), ("xyz", None)]
)
def test_an_unknown_function_is_compared_with_the_table(name, suggested):
    reported = cel_mistakes.unknown({name})
    assert reported == f"known functions only, not {name}" + (f"; did you mean {suggested}?" if suggested else "")
