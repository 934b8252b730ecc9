"""The command line: python -m docs.generator writes the reference pages that have their source in the code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from docs.generator import command_pages, fields, messages, values

if TYPE_CHECKING:
    from collections.abc import Callable

REFERENCE = Path(__file__).parents[1] / "reference"
PAGES: dict[str, Callable[[], str]] = {
    "policy.md": fields.page,
    "commands.md": command_pages.page,
    "chart.md": values.page,
    "bus.md": messages.page,
}
"""`make crds` writes cel-functions.md: the definition quotes the same table."""


def main() -> int:
    """Write the pages."""
    for name, page in PAGES.items():
        (REFERENCE / name).write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
