"""Markdown from plain text."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_CODE = re.compile(r"(`[^`]+`)")
_SPECIAL = re.compile(r"([*_|\[\]\\])")


def escaped(text: str) -> str:
    """Text that a table's cell shows as it stands; what is between backticks stays code, paragraphs become breaks."""
    plain = "".join(_part(part) for part in _CODE.split(text.strip()))
    return re.sub(r"\s*\n\s*\n\s*", "<br><br>", plain).replace("\n", " ")


def _part(text: str) -> str:
    """`<` becomes an entity: MkDocs shows the backslash of an escaped one."""
    return text.replace("|", r"\|") if _CODE.fullmatch(text) else _SPECIAL.sub(r"\\\1", text).replace("<", "&lt;")


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a table."""
    return [_row(header), "|" + "---|" * len(header), *map(_row, rows), ""]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
