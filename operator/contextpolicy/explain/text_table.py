"""Tables as text that fit their reader's terminal, and do nothing to it. Pure."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    Row = Sequence[str]

GAP = "  "
LEAST = 20
"""Columns of a terminal that the last column of a table needs to be wrapped there."""


def text_table(
    head: Row, rows: Sequence[Row], width: int | None, *, right: Collection[int] = (), indent: str = ""
) -> Iterator[str]:
    """Columns as wide as their content, those numbered in `right` aligned there; nothing without rows.

    What is wider than `width` (None: unlimited) has its last column wrapped, or, if that is not enough, a paragraph
    for each row: its first cell, and below it each other cell beside its column's heading, or below a long one.
    """
    if not rows:
        return
    rows = [[printable(cell) for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    before = len(indent) + sum(size + len(GAP) for size in widths[:-1])
    if width is not None and before + widths[-1] > width and (before + LEAST > width or len(head) - 1 in right):
        for row in rows:
            yield from _paragraph(head, row, width, indent)
        return
    for row in (head, *rows):
        cells = [
            cell.rjust(size) if i in right else cell.ljust(size)
            for i, (cell, size) in enumerate(zip(row, widths, strict=True))
        ]
        yield from _line(indent + GAP.join(cells), before, width)


def wrapped(text: str, width: int | None, first: str = "", others: str = "") -> list[str]:
    """The text in lines of at most `width`, indented by `first` and `others`; a longer word is kept whole."""
    text = printable(text)
    if width is None:
        return [first + text]
    return textwrap.wrap(
        text, width, initial_indent=first, subsequent_indent=others, break_long_words=False, break_on_hyphens=False
    )


def printable(text: str) -> str:
    """The text without what moves a terminal's cursor, or worse: much of what is shown comes from others."""
    return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


def _line(line: str, before: int, width: int | None) -> Iterator[str]:
    """A row of the table; its last column, which begins after `before` characters, wrapped."""
    line = line.rstrip()
    if width is None or len(line) <= width:
        yield line
    else:
        first, *others = textwrap.wrap(line[before:], width - before)
        yield line[:before] + first
        yield from (" " * before + other for other in others)


def _paragraph(head: Row, row: Row, width: int, indent: str) -> Iterator[str]:
    yield from textwrap.wrap(row[0], width, initial_indent=indent, subsequent_indent=indent)
    size, inner = max(len(name) for name in head[1:]), f"{indent}  "
    beside = width - len(inner) - size - len(GAP) >= min(LEAST, max(map(len, row[1:])))
    for name, cell in zip(head[1:], row[1:], strict=True):
        label = f"{inner}{name.ljust(size)}{GAP}" if beside else f"{inner}{GAP}"
        if cell and not beside:
            yield from textwrap.wrap(name, width, initial_indent=inner, subsequent_indent=inner)
        if cell:
            yield from textwrap.wrap(cell, width, initial_indent=label, subsequent_indent=" " * len(label))
