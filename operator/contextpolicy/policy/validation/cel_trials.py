"""What the CEL library finds of parts of an expression that are the same each time: it tries them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.cel_kinds import ValueKind
from contextpolicy.policy.lean_cel import cel

if TYPE_CHECKING:
    from contextpolicy.policy.cel_kinds import Function


def failing_call(call: str, function: Function) -> list[str]:
    """What is wrong with a call with constants only, such as a duration: it fails each time, or never."""
    if function.run is not None or function.returns is ValueKind.BOOL:
        return []
    try:
        cel.compile(call).execute(cel.Context())
    except (ValueError, RuntimeError, TypeError, ArithmeticError):
        return [f"{call} has no value: {function.returns} is written as in {function.constant}"]
    return []


def failing_pattern(pattern: str) -> list[str]:
    """What is wrong with a regular expression, as it is quoted: the library's are not Python's."""
    try:
        cel.compile(f'"".matches({pattern})').execute(cel.Context())
    except (ValueError, RuntimeError):
        return [f"{pattern} is not a valid regular expression"]
    return []
