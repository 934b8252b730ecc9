"""The command line: python -m crds writes what the table of CEL functions says into the definition and its page.

The definition is copied to where it is read.
"""

from __future__ import annotations

import re
import sys
import textwrap
from pathlib import Path

from contextpolicy.policy.cel_functions import KEYWORDS, LIBRARY, OWN, RESERVED, Macro
from crds.cel_page import page

ROOT = Path(__file__).parents[1]
DEFINITION = ROOT / "crds" / "contextpolicies.contextpolicy.dev.yaml"
PAGE = ROOT / "docs" / "reference" / "cel-functions.md"
COPIES = ("charts/contextpolicy/files", "operator/contextpolicy/policy/validation")
WIDTH = 120


def written(definition: str) -> str:
    """The definition with what comes from the table: the manual's paragraph and the words that are no names."""
    for place, text in (
        (r"Besides CEL's own functions there are.*?(?=\n\n)", _manual()),
        (r"!\(self\.name in \[[^]]*\]\)(?=\n +message: expected a name that is not a reserved)", _names(RESERVED)),
        (r"!\(self\.name in \[[^]]*\]\)(?=\n +message: expected a name that is not a keyword)", _names(KEYWORDS)),
    ):
        definition = _replaced(definition, place, text)
    return definition


def _manual() -> str:
    *functions, last = (f"{function.example}, {function.meaning}" for function in OWN)
    library = ", ".join(function.name for function in LIBRARY)
    return (
        f"Besides CEL's own functions there are {'; '.join(functions)}; and {last}. CEL's own are {library}, and the "
        f"loops {', '.join(Macro)}: docs/reference/cel-functions.md has what each takes and returns, with an example."
    )


def _names(refused: tuple[str, ...]) -> str:
    return f"!(self.name in [{', '.join(map(repr, refused))}])"


def _replaced(definition: str, place: str, text: str) -> str:
    """The definition with the text folded into the block at the place; LookupError unless there is one such place."""

    def folded(match: re.Match[str]) -> str:
        indent = match["indent"]
        return textwrap.fill(
            text, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
        )

    result, count = re.subn(rf"^(?P<indent> +){place}", folded, definition, flags=re.DOTALL | re.MULTILINE)
    if count != 1:
        raise LookupError(f"{DEFINITION}: {count} places for {text[:40]!r}, expected: 1")
    return result


def main() -> int:
    """Write the definition, its copies and the page."""
    definition = written(DEFINITION.read_text(encoding="utf-8"))
    for folder in ("crds", *COPIES):
        (ROOT / folder / DEFINITION.name).write_text(definition, encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
