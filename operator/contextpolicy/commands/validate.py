"""`contextpolicy validate`: what the API server and the operator would refuse, before anyone applies it."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.commands.structured_output import add_output, structured

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from contextpolicy.policy.validation.check import CheckReport
    from contextpolicy.policy.validation.problem import Problem

SUFFIXES = (".yaml", ".yml", ".json")


def add(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "validate",
        help="check policy files without a cluster",
        description="Report everything that the API server or the operator would refuse, for all files at once. "
        "Liveness probes of pods that a policy may suspend are checked too; other objects are skipped with a note.",
    )
    parser.add_argument("files", nargs="+", metavar="POLICY", help="a YAML file, a directory of them, or - for stdin")
    add_types_argument(parser)
    add_output(parser)
    parser.set_defaults(main=main)


def add_types_argument(parser: argparse.ArgumentParser) -> None:
    """Declare `--types`, where a robot's own ROS 2 messages are defined, for every command that reads them."""
    parser.add_argument(
        "--types",
        metavar="DIR",
        type=Path,
        help="a folder with .msg and .idl files, such as an installed package's share directory: instead of "
        "ConfigMaps that are not among the files",
    )


def main(arguments: argparse.Namespace) -> int:
    """Check and print; the exit code is for CI."""
    from contextpolicy.policy.definition_files import of_folder
    from contextpolicy.policy.validation.check import check

    types = None if arguments.types is None else of_folder(arguments.types)
    texts, unreadable = _texts(arguments.files)
    report = check(texts, types)
    report.problems[:0] = unreadable
    if arguments.output == "table":
        _print_text(report)
    else:
        print(structured(_document(report), arguments.output))
    return 2 if unreadable else 0 if _is_valid(report) else 1


def _texts(names: list[str]) -> tuple[list[tuple[str, str]], list[Problem]]:
    """Name and text of each file, and a problem for each that can't be read: the others are checked all the same."""
    from contextpolicy.errors import unreadable
    from contextpolicy.policy.validation.documents import WHOLE_FILE, text_of
    from contextpolicy.policy.validation.problem import Problem

    texts, problems = [], []
    for path in _paths(names):
        name = "<stdin>" if path is None else str(path)
        try:
            with nullcontext(sys.stdin) if path is None else path.open(encoding="utf-8") as file:
                texts.append((name, text_of(file)))
        except (OSError, UnicodeDecodeError) as error:
            problems.append(Problem(name, WHOLE_FILE, unreadable(error)))
    return texts, problems


def _paths(names: list[str]) -> Iterator[Path | None]:
    """Each file, those of directories too; None is standard input."""
    for name in names:
        path = Path(name)
        if name == "-":
            yield None
        elif path.is_dir():
            yield from sorted(p for p in path.rglob("*") if p.suffix in SUFFIXES and p.is_file())
        else:
            yield path


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
    print(", ".join(counts) if report.seen or errors else "no ContextPolicy found", file=sys.stderr)


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _document(report: CheckReport) -> dict[str, Any]:
    """`found` counts the policies there are, `policies` are those of them that are valid."""
    return {
        "valid": _is_valid(report),
        "found": report.seen,
        "policies": [{"file": source.file, "policy": policy.reference} for source, policy in report.policies],
        "problems": [problem.as_json() for problem in report.problems],
        "skipped": report.skipped,
    }
