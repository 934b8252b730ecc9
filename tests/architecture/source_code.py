"""The modules of this project as texts, and what they import."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
OPERATOR = ROOT / "operator"
ROBOTKIT = ROOT / "modules" / "robotkit"
PACKAGE = OPERATOR / "contextpolicy"

IMPORTED_FROM = {
    OPERATOR: ["contextpolicy"],
    ROBOTKIT: ["robotkit"],
    ROOT: ["modules", "timelines", "charts", "tests"],
}
"""The folders on Python's path, and the packages in each."""


def imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or "." * node.level
            yield from (f"{node.module}.{alias.name}" for alias in node.names if node.module == "contextpolicy")


def sources(root, package):
    """The text of each module of a package, by the name under which it is imported."""
    for path in (root / package).glob("**/*.py"):
        name = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
        yield name, path.read_text(encoding="utf-8")


def modules_imported(source, modules):
    """Those of the modules that a source imports, also inside functions and for types only."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from {alias.name for alias in node.names} & modules
        elif isinstance(node, ast.ImportFrom):
            yield from {f"{node.module}.{alias.name}" for alias in node.names} & modules or {node.module} & modules


def importers_of(package, texts):
    """The names of the modules that import a package."""
    return {name for name, text in texts if package in {other.partition(".")[0] for other in imports(ast.parse(text))}}


TEXTS = {name: text for root, packages in IMPORTED_FROM.items() for p in packages for name, text in sources(root, p)}
