"""What the wildcards of a key expression stand for in a key."""

from __future__ import annotations

from functools import lru_cache


@lru_cache(maxsize=256)
def matched(expression: str, key: str) -> str:
    """The chunks of `key` that the wildcards of `expression` match: `left` of lift/left for lift/*.

    Those of several wildcards are joined by slashes. The whole key where the expression does not select it. Cached:
    each sample asks, and there are few keys.
    """
    found = _match(expression.split("/"), key.split("/"))
    return key if found is None else "/".join(found)


def _match(expression: list[str], key: list[str]) -> list[str] | None:
    if not expression:
        return None if key else []
    first, *rest = expression
    if first == "**":
        # The fewest chunks first, so that a later wildcard gets what is left.
        tails = ((key[:length], _match(rest, key[length:])) for length in range(len(key) + 1))
        return next(([*head, *tail] for head, tail in tails if tail is not None), None)
    if not key or first not in {"*", key[0]}:
        return None
    tail = _match(rest, key[1:])
    return None if tail is None else [*key[:1], *tail] if first == "*" else tail
