"""`--output`, the same for every command that shows an object."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse


def add_output(parser: argparse.ArgumentParser) -> None:
    """Declare the option."""
    parser.add_argument("-o", "--output", choices=("text", "json", "yaml"), default="text", help="default: text")


def structured(document: Any, output: str) -> str:
    """The document as JSON or YAML."""
    import yaml

    if output == "json":
        return json.dumps(document, indent=2)
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True).rstrip("\n")
