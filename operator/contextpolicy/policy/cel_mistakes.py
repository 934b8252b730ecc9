"""What is wrong with a CEL source that does not compile, in words for readers who do not know CEL."""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING

from contextpolicy.policy import cel_syntax
from contextpolicy.policy.cel_functions import NAMES
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable

_TEXTS = re.compile(r"""\"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'""")
_OTHER_LANGUAGES = (
    (re.compile(r"\band\b|(?<!&)&(?!&)", re.IGNORECASE), "&& for and"),
    (re.compile(r"\bor\b|(?<!\|)\|(?!\|)", re.IGNORECASE), "|| for or"),
    (re.compile(r"\bnot\b", re.IGNORECASE), "! for not"),
    (re.compile(r"(?<![=!<>])=(?![=~])"), "== for equality"),
    (re.compile(r"=~"), ".matches(...) for a pattern match"),
    (re.compile(r"===|!=="), "== and != for equality"),
    (re.compile(r"<>"), "!= for inequality"),
    (re.compile(r"\b(True|False)\b"), "true and false in lower case"),
    (re.compile(r"\bNone\b|\bnil\b"), "null for no value"),
    (re.compile(r"\*\*|\^"), "a product for a power"),
)
_WHOLE = re.compile(r"(?<![\w.])\d{19,}(?![\w.])")
LARGEST_WHOLE = 2**63 - 1
_PLACE = re.compile(r"<input>:\d+:(?P<column>\d+): ")


def unknown(functions: Iterable[str]) -> str:
    """What is allowed instead of functions that do not exist."""
    named = sorted(functions)
    return f"known functions only, not {', '.join(named)}" + "".join(did_you_mean(name, NAMES) for name in named)


def explain(source: str, error: ValueError) -> str:
    """One sentence: what CEL writes in place of another language's operators, else where the parser gave up."""
    bare = _TEXTS.sub('""', source)
    hints = [hint for pattern, hint in _OTHER_LANGUAGES if pattern.search(bare)]
    place = _PLACE.search(str(error))
    if place is None:
        return "it " + str(error).splitlines()[0]
    if hints:
        return "in CEL, write " + ", ".join(dict.fromkeys(hints))
    large = [literal for literal in _WHOLE.findall(bare) if LARGEST_WHOLE < int(literal) <= sys.float_info.max]
    if large:
        return f"an integer is at most {LARGEST_WHOLE}: write {large[0]}.0, a double"
    try:
        cel_syntax.parse(source)
    except ValueError as own:
        return f"it {own}"
    return f"it has a syntax error at character {int(place['column'])}"
