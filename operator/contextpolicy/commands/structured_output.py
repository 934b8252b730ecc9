"""`--output`, the same for every command that shows an object."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping


SCHEMA = 1
"""The version of every document: it grows when a field goes or means something else, not when one is added."""


def add_output(parser: argparse.ArgumentParser, *others: str) -> None:
    """Declare the option: `table` is what people read, sentences too; `others` are formats beside the usual ones."""
    choices = ("table", "json", "yaml", *others)
    listed = ", ".join(choices[:-1]) + f" or {choices[-1]}"
    parser.add_argument(
        "-o",
        "--output",
        metavar="FORMAT",
        choices=choices,
        default="table",
        help=f"{listed} (default: table, for people)",
    )


def structured(content: Mapping[str, Any], output: str) -> str:
    """The content as a JSON or YAML document with `schemaVersion`."""
    import yaml

    text = json.dumps({"schemaVersion": SCHEMA, **content}, indent=2)
    if output == "json":
        return text
    # The very document that JSON has: YAML's writer refuses an enumeration, and writes the same list once.
    return yaml.safe_dump(json.loads(text), sort_keys=False, allow_unicode=True).rstrip("\n")
