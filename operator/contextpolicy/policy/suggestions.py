"""Suggestions for an unknown name."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """`; did you mean gyro?`, to append to a message; empty when no known name is close.

    The dashes before options do not count: all options have them.
    """
    by_letters = {_letters(word): word for word in known}
    near = get_close_matches(_letters(str(name)), by_letters, n=1, cutoff=0.6)
    return f"; did you mean {by_letters[near[0]]}?" if near else ""


def _letters(name: str) -> str:
    return name.lower().lstrip("-")
