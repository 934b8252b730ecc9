"""The reference page of the command line, from the parsers of the commands."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING
from unittest import mock

from contextpolicy.cli import build_parser

if TYPE_CHECKING:
    from collections.abc import Iterator

WIDTH = 100
"""Columns of the help, whatever the terminal that the page is written at."""
_INTRODUCTION = """\
# Commands

`--help` of each command prints the same; `make docs` writes this page from it. `kubectl ctxp` is the same program under
the name that kubectl looks for.
"""


def page() -> str:
    """The page as Markdown."""
    with mock.patch.dict(os.environ, {"COLUMNS": str(WIDTH + 2)}):
        return "\n".join([_INTRODUCTION, *_sections(build_parser("contextpolicy"))])


def _sections(parser: argparse.ArgumentParser) -> Iterator[str]:
    for action in parser._actions:  # noqa: SLF001 - argparse shows its sub-commands nowhere else
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - as above
            for name, command in action.choices.items():
                yield from (f"## {name}", "", "```text", command.format_help().rstrip(), "```", "")
