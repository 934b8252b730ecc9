"""What a regular expression costs: the library compiles it at each evaluation, and then walks the text."""

from __future__ import annotations

import re

from contextpolicy.policy.lean_cel import cel

MAX_PATTERN = 64
"""Characters of a regular expression."""
MATCH = 3
"""Steps that matching takes for each 32 characters of the text (measured: 26 ms for 900 kB)."""

_ATOMS = re.compile(r"\\[wWpP]|\\[dDsS]|\.|\[\^|.", re.DOTALL)
_LETTERS, _CLASS, _CHARACTER, _FOLDED, _FOLDED_RANGE = 1000, 120, 5, 50, 10_000
"""Steps that compiling takes, for a class of Unicode's letters (230 us), another class (37 us), a character (2 us), and
one whose case is ignored (12 us; in a range beyond ASCII 2.5 ms)."""


def steps(literal: str) -> int:
    """The steps that compiling a pattern takes, given as a string literal; ValueError when it is none or too large."""
    pattern = _text(literal)
    if len(pattern) > MAX_PATTERN or "{" in pattern:
        raise ValueError(f"matches a pattern of more than {MAX_PATTERN} characters or with counted repetitions")
    folds = re.search(r"\(\?[a-zA-Z]*i", pattern) is not None
    return sum(_steps(atom, folds=folds) for atom in _ATOMS.findall(pattern))


def _text(literal: str) -> str:
    """The text that the literal stands for, as an escape can hide a repetition."""
    text = cel.compile(literal).execute(cel.Context())
    if not isinstance(text, str):
        raise ValueError("matches a pattern that is not a string in quotes")  # noqa: TRY004 - it is the policy's mistake
    return text


def _steps(atom: str, *, folds: bool) -> int:
    if atom[0] == "\\" and atom[-1] in "wWpP":
        return _LETTERS
    if len(atom) > 1 or atom == ".":
        return _CLASS
    if not folds:
        return _CHARACTER
    return _FOLDED if atom.isascii() else _FOLDED_RANGE
