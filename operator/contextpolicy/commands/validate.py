"""`contextpolicy validate`: what the API server and the operator would refuse, before anyone applies it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from contextpolicy.policy.validation.check import CheckReport

SUFFIXES = (".yaml", ".yml", ".json")


def add(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "validate",
        help="check policy files without a cluster",
        description="Tell everything that the API server or the operator would refuse, all files and findings at once. "
        "Objects of other kinds are skipped with a note. Exit codes: 0 valid (warnings included), 1 refused, 2 a file "
        "that cannot be read.",
    )
    parser.add_argument("files", nargs="+", metavar="POLICY", help="a YAML file, a directory of them, or - for stdin")
    add_types_argument(parser)
    parser.add_argument("--output", choices=("text", "json"), default="text", help="default: text, one line a problem")
    parser.set_defaults(main=main)


def add_types_argument(parser: argparse.ArgumentParser) -> None:
    """Declare `--types`, where a robot's own ROS 2 messages are defined, for every command that reads them."""
    parser.add_argument(
        "--types",
        metavar="DIR",
        type=Path,
        help="a folder with .msg and .idl files, such as an installed package's share: messages of ConfigMaps "
        "that are in none of the files",
    )


def main(arguments: argparse.Namespace) -> int:
    """Check and print; the exit code is for CI."""
    from contextpolicy.errors import DefinitionError
    from contextpolicy.policy.definition_files import of_folder
    from contextpolicy.policy.validation.check import check

    try:
        texts = list(_texts(arguments.files))
        types = None if arguments.types is None else of_folder(arguments.types)
    except (OSError, UnicodeDecodeError, DefinitionError) as error:
        print(f"contextpolicy validate: {error}", file=sys.stderr)
        return 2
    report = check(texts, types)
    (_print_json if arguments.output == "json" else _print_text)(report)
    return 0 if _is_valid(report) else 1


def _texts(names: list[str]) -> Iterator[tuple[str, str]]:
    for name in names:
        if name == "-":
            yield "<stdin>", sys.stdin.read()
            continue
        path = Path(name)
        inside = sorted(p for p in path.rglob("*") if p.suffix in SUFFIXES and p.is_file())
        for file in inside if path.is_dir() else [path]:
            yield str(file), file.read_text(encoding="utf-8")


def _is_valid(report: CheckReport) -> bool:
    """A run that found no policy proves nothing: a wrong path must not pass as valid."""
    return report.seen > 0 and not report.errors


def _print_text(report: CheckReport) -> None:
    for problem in report.problems:
        print(problem)
    for note in report.skipped:
        print(f"skipped: {note}", file=sys.stderr)
    errors = len(report.errors)
    counts = (
        _count(report.seen, "policy", "policies"),
        _count(errors, "error"),
        _count(len(report.problems) - errors, "warning"),
    )
    print(", ".join(counts) if report.seen else "no ContextPolicy found", file=sys.stderr)


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _print_json(report: CheckReport) -> None:
    document = {
        "valid": _is_valid(report),
        "policies": [{"file": source.file, "policy": policy.reference} for source, policy in report.policies],
        "problems": [problem.as_json() for problem in report.problems],
        "skipped": report.skipped,
    }
    print(json.dumps(document, indent=2))
