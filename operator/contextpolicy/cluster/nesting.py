"""The API server's JSON, however deep: it takes objects of 10,000 levels, and Python's decoder some 990.

Only what is free of any form can be so deep, such as the `example` of a policy's stream. One such policy would keep all
others from being read.
"""

from __future__ import annotations

import json
import re
from typing import Any

DEEPEST = 64
"""Levels that are kept. A list of policies has 8 above an example, and a sample has 32 at most."""

_TOKEN = re.compile(r'"(?:[^"\\]++|\\.)*+"|[\[{]|[\]}]', re.DOTALL)


def loads(text: str | bytes) -> Any:
    """The value of a JSON text; where it nests too deeply for Python, null stands for what is below DEEPEST levels."""
    try:
        return json.loads(text)
    except RecursionError:
        return json.loads(shallow(text if isinstance(text, str) else text.decode()))


def loads_shallow(text: str) -> Any:
    """The same with null for what is below DEEPEST levels in any case, so that the value can be copied."""
    return json.loads(shallow(text) if text.count("[") + text.count("{") > DEEPEST else text)


def shallow(text: str) -> str:
    """The JSON text with null for what is below DEEPEST levels."""
    kept: list[str] = []
    begin = depth = 0
    for token in _TOKEN.finditer(text):
        if token[0] in "[{":
            depth += 1
            if depth == DEEPEST + 1:
                kept += [text[begin : token.start()], "null"]
        elif token[0] in "]}":
            if depth == DEEPEST + 1:
                begin = token.end()
            depth -= 1
    kept.append(text[begin:])
    return "".join(kept)
