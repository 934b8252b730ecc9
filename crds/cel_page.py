"""The reference page of the functions that expressions may call, from their table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.cel_functions import LIBRARY, OWN, Macro

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.policy.cel_kinds import Function

_INTRODUCTION = """\
# CEL functions

What conditions, scores, filters and features of a ContextPolicy may call. `make crds` writes this page from the table
in `operator/contextpolicy/policy/cel_functions.py`, which the operator and `contextpolicy validate` go by too.

The examples read a stream `imu` whose samples have `gyro` (a list), `speed` (a number), `frame` (a string) and `time`
(a string). A scalar sample, such as `5`, is read as `imu.value`.
"""
_ROWS = ("| call | takes | returns | meaning |", "|---|---|---|---|")


def page() -> str:
    """The page as Markdown."""
    lines = [
        _INTRODUCTION,
        "## What CEL does not have",
        "",
        *_ROWS,
        *_rows(OWN),
        "",
        "`age` must be compared with a number. Neither `heard` nor `age` can be used in `filter` and `features`.",
        "",
        "## CEL's own",
        "",
        *_ROWS,
        *_rows(LIBRARY),
        "",
        "Dates and times are in UTC: the calendar functions take no time zone.",
        "",
        "## Loops over lists and maps",
        "",
        "| call | meaning |",
        "|---|---|",
        *(f"| `{macro.example}` | {macro.meaning} |" for macro in Macro),
        "",
        "Loops over long lists, and loops in loops, have a bounded cost, which `contextpolicy validate` checks.",
    ]
    return "\n".join(lines) + "\n"


def _rows(functions: Iterable[Function]) -> Iterator[str]:
    for one in functions:
        taken = ", ".join(" or ".join(kinds) for kinds in one.takes) + (", ..." if one.variadic else "")
        yield f"| `{one.example}` | {taken} | {one.returns} | {one.meaning} |"
