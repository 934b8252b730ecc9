"""Which keys a Zenoh key expression selects, decided without Zenoh.

`*` is any one chunk, `**` any number of chunks, `$*` any part of a chunk. Chunks that begin with `@` are verbatim:
no wildcard selects them or counts in them.
"""

from __future__ import annotations

import re
from functools import cache


def includes(expression: str, key: str) -> bool:
    """Whether `expression` selects `key`, a key without wildcards."""
    return _pattern(expression).fullmatch(key + "/") is not None


@cache
def _pattern(expression: str) -> re.Pattern[str]:
    """A regular expression over the key with a closing slash, so that every chunk ends alike."""
    return re.compile("".join(_chunk(chunk) for chunk in expression.split("/")))


def _chunk(chunk: str) -> str:
    if chunk == "**":
        return "(?:(?!@)[^/]+/)*"
    if chunk == "*":
        return "(?!@)[^/]+/"
    if chunk.startswith("@"):
        return re.escape(chunk) + "/"
    return "(?!@)" + "[^/]*".join(re.escape(part) for part in chunk.split("$*")) + "/"
