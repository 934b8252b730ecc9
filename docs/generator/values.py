"""The reference page of the charts' values, from the comments above them in values.yaml."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from docs.generator.markdown import escaped, table

if TYPE_CHECKING:
    from collections.abc import Iterator

CHARTS = Path(__file__).parents[2] / "charts"
_INTRODUCTION = """\
# Chart values

`make docs` writes this page from the comments in `values.yaml` of each chart. A schema refuses unknown values.
The robot chart's `modules` has an entry for each module, whose fields its `values.yaml` explains.
"""
_KEY = re.compile(r"( *)([\w-]+):")
WHOLE, LEFT_OUT = "resources", "modules"
"""A value that counts as one, although it has parts; and one with an entry for each module."""


def page() -> str:
    """The page as Markdown."""
    lines = [_INTRODUCTION]
    for chart, about in (("contextpolicy", "the operator's chart"), ("robot", "the modules' chart")):
        lines += [f"## {chart}: {about}", "", *table(("value", "default", "meaning"), rows(chart))]
    return "\n".join(lines)


def rows(chart: str) -> Iterator[tuple[str, str, str]]:
    """Every value with its path, its default and its comment."""
    text = (CHARTS / chart / "values.yaml").read_text(encoding="utf-8")
    comments = dict(_comments(text))
    for path, value in _leaves(yaml.safe_load(text)):
        meaning = comments[path] or comments.get(path[:-1], "")
        yield f"`{'.'.join(path)}`", f"`{json.dumps(value)}`", escaped(meaning)


def _leaves(node: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, value in node.items():
        if isinstance(value, dict) and value and name != WHOLE:
            yield from _leaves(value, (*path, name)) if name != LEFT_OUT else ()
        else:
            yield (*path, name), value


def _comments(text: str) -> Iterator[tuple[tuple[str, ...], str]]:
    """The comment above each key, by the key's path."""
    comment: list[str] = []
    path: list[str] = []
    for line in text.splitlines():
        key = _KEY.match(line)
        if line.lstrip().startswith("#"):
            comment.append(line.lstrip().removeprefix("#").strip())
        elif key:
            path = [*path[: len(key[1]) // 2], key[2]]
            yield tuple(path), " ".join(comment)
            comment = []
        else:
            comment = []
