"""What the wildcards of a key expression stand for in a key."""

from __future__ import annotations

from functools import lru_cache
from itertools import starmap

MANY, ONE, SOME = "**", "*", "$*"
"""Any chunks, any chunk, and anything within a chunk."""


@lru_cache(maxsize=256)
def matched(expression: str, key: str) -> str:
    """The chunks of `key` that the wildcards of `expression` match: `left` of lift/left for lift/*.

    Those of several wildcards are joined by slashes, and one with `$*` counts as a whole. The whole key where the
    expression does not select it. Cached: each sample asks, and there are few keys.
    """
    found = _match(expression.split("/"), key.split("/"))
    return key if found is None else "/".join(found)


def may_match(expression: str, text: str) -> bool:
    """Whether the wildcards of `expression` match this text in some key; True where `**` does."""
    chunks, parts = expression.split("/"), text.split("/")
    if MANY in chunks:
        return True
    if sum(map(_is_wild, chunks)) != len(parts):
        return False
    filled = iter(parts)
    return _match(chunks, [next(filled) if _is_wild(chunk) else chunk for chunk in chunks]) is not None


def _match(expression: list[str], key: list[str]) -> list[str] | None:
    """Each `**` stands for the fewest chunks, so that a later wildcard gets what is left.

    So what follows it is where it is found first, and is never looked for again: the sender chooses the key, and must
    not choose how long this takes.
    """
    first, *others = _parted(expression)
    if not others:
        return _wild(first, key) if len(first) == len(key) and _fits(first, key, 0) else None
    *middle, last = others
    at, end = len(first), len(key) - len(last)
    if at > end or not _fits(first, key, 0) or not _fits(last, key, end):
        return None
    found = _wild(first, key)
    for part in middle:
        start = next((place for place in range(at, end - len(part) + 1) if _fits(part, key, place)), None)
        if start is None:
            return None
        found += key[at:start] + _wild(part, key[start:])
        at = start + len(part)
    return found + key[at:end] + _wild(last, key[end:])


def _parted(expression: list[str]) -> list[list[str]]:
    """The chunks before, between and after each `**`."""
    parts: list[list[str]] = [[]]
    for chunk in expression:
        if chunk == MANY:
            parts.append([])
        else:
            parts[-1].append(chunk)
    return parts


def _fits(part: list[str], key: list[str], at: int) -> bool:
    return all(starmap(_selects, zip(part, key[at : at + len(part)], strict=True)))


def _selects(chunk: str, of_key: str) -> bool:
    if chunk == of_key:
        return True
    return _is_wild(chunk) and not of_key.startswith("@") and (chunk == ONE or _fills(chunk.split(SOME), of_key))


def _fills(texts: list[str], of_key: str) -> bool:
    """Whether the chunk has these texts in this order, from its beginning to its end, whatever is between them."""
    first, *middle, last = texts
    if len(first) + len(last) > len(of_key) or not (of_key.startswith(first) and of_key.endswith(last)):
        return False
    between = of_key[len(first) : len(of_key) - len(last)]
    for text in middle:
        _, found, between = between.partition(text)
        if not found:
            return False
    return True


def _wild(part: list[str], key: list[str]) -> list[str]:
    return [of_key for chunk, of_key in zip(part, key, strict=False) if _is_wild(chunk)]


def _is_wild(chunk: str) -> bool:
    return chunk == ONE or SOME in chunk
