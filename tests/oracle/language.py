"""CEL as the reference model reads it: exact numbers, and no value where a stream has none.

Only what `generator` writes: numbers and truth values of streams, contexts, `heard`, `age`, `has`, `abs`, `min`, `max`.
"""

from __future__ import annotations

import ast
import operator
import re
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING, Protocol, TypeAlias

from tests.oracle.units import SECOND

if TYPE_CHECKING:
    from collections.abc import Mapping

Number: TypeAlias = int | Fraction
Value: TypeAlias = bool | Number | None
"""None is an unknown one: a stream without a value, a window without a sample."""


class View(Protocol):
    """What expressions see at one moment."""

    def fields(self, stream: str) -> Mapping[str, Value] | None:
        """The stream's value, with its features; None where it has none."""

    def is_older(self, stream: str, age: int, *, strictly: bool) -> bool:
        """Whether the stream's last value is at least, or strictly more than, so old."""

    def is_active(self, context: str) -> bool:
        """Whether the context has effects."""


def evaluate(source: str, view: View) -> Value:
    """What the expression is worth."""
    return _value(_tree(source), view)


@cache
def streams_in(source: str) -> frozenset[str]:
    """The streams that the expression reads or asks about."""
    names = {node.id for node in ast.walk(_tree(source)) if isinstance(node, ast.Name)}
    return frozenset(names - {"contexts", "heard", "age", "has", "abs", "min", "max"})


@cache
def contexts_in(source: str) -> frozenset[str]:
    """The contexts that the expression reads."""
    return frozenset(name for node in ast.walk(_tree(source)) if (name := _context(node)) is not None)


@cache
def _tree(source: str) -> ast.expr:
    for cel, python in ((r"&&", " and "), (r"\|\|", " or "), (r"!(?!=)", " not ")):
        source = re.sub(cel, python, source)
    for word in ("true", "false"):
        source = re.sub(rf"\b{word}\b", word.capitalize(), source)
    tree = ast.parse(source.strip(), mode="eval").body
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, float):
            node.value = Fraction(str(node.value))  # type: ignore[assignment]
    return tree


def _context(node: ast.AST) -> str | None:
    """The context that the node stands for."""
    match node:
        case ast.Attribute(value=ast.Name(id="contexts"), attr=name):
            return name
        case ast.Subscript(value=ast.Name(id="contexts"), slice=ast.Constant(value=str() as name)):
            return name
    return None


def _value(node: ast.expr, view: View) -> Value:  # noqa: C901, PLR0911 - a case for each construct
    context = _context(node)
    if context is not None:
        return view.is_active(context)
    match node:
        case ast.Constant(value=value):
            return value  # type: ignore[return-value]
        case ast.BoolOp(op=op, values=parts):
            return _absorbed([_value(part, view) for part in parts], decides=isinstance(op, ast.Or))
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            negated = _value(operand, view)
            return None if negated is None else not negated
        case ast.Compare(
            left=ast.Call(func=ast.Name(id="age"), args=[ast.Name(id=stream)]), ops=[op], comparators=[by]
        ):
            return _older(stream, op, int(_number(by, view) * SECOND), view)
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return _compared(_value(left, view), op, _value(right, view))
        case ast.BinOp(left=left, op=op, right=right):
            return _computed(_value(left, view), op, _value(right, view))
        case ast.Attribute(value=ast.Name(id=stream), attr=field):
            return (view.fields(stream) or {}).get(field)
        case ast.Call(func=ast.Name(id="heard"), args=[ast.Name(id=stream)]):
            return view.fields(stream) is not None
        case ast.Call(func=ast.Name(id="has"), args=[ast.Attribute(value=ast.Name(id=stream), attr=field)]):
            return field in (view.fields(stream) or {})
        case ast.Call(func=ast.Name(id=function), args=arguments):
            return _called(function, [_value(argument, view) for argument in arguments])
    raise ValueError(f"the model can't read {ast.unparse(node)}")


def _number(node: ast.expr, view: View) -> Number:
    value = _value(node, view)
    if value is None:
        raise ValueError(f"{ast.unparse(node)} has no value")
    return value


def _absorbed(values: list[Value], *, decides: bool) -> Value:
    """One value can decide alone, whatever the unknown ones are."""
    if any(value is decides for value in values):
        return decides
    return None if None in values else not decides


def _older(stream: str, op: ast.cmpop, age: int, view: View) -> bool:
    older = view.is_older(stream, age, strictly=isinstance(op, ast.Gt | ast.LtE))
    return older is isinstance(op, ast.Gt | ast.GtE)


_COMPARISONS = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


def _compared(left: Value, op: ast.cmpop, right: Value) -> Value:
    if left is None or right is None:
        return None
    return bool(_COMPARISONS[type(op)](left, right))


def _computed(left: Value, op: ast.operator, right: Value) -> Value:
    if left is None or right is None:
        return None
    return left + right if isinstance(op, ast.Add) else left * right


def _called(function: str, arguments: list[Value]) -> Value:
    if None in arguments:
        return None
    numbers = [argument for argument in arguments if argument is not None]
    match function:
        case "abs":
            return max(numbers[0], -numbers[0])
        case "min":
            return min(numbers)
        case "max":
            return max(numbers)
    raise ValueError(f"the model can't read {function}()")
