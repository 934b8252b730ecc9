"""The command line: `contextpolicy COMMAND`.

Exit codes: `commands.exit_codes`.
"""

from __future__ import annotations

import argparse
import errno
import io
import os
import sys
from contextlib import suppress
from importlib import import_module

from contextpolicy.commands import completion, exit_codes
from contextpolicy.commands.command_parser import CommandParser
from contextpolicy.commands.exit_codes import FAILED, INTERRUPTED, READER_GONE
from contextpolicy.errors import ContextPolicyError

ON_THE_CLUSTER = (
    *("status", "top", "explain", "why_not", "force", "mode", "shadow", "adopt", "doctor", "record", "restore"),
    *("credentials", "certificates"),
)
ON_THE_DESK = ("validate", "simulate", "suggest", "skeleton", "graph", "completion")
IN_THE_CLUSTER = ("run", "router", "agent", "agent_supervisor")
"""The modules of commands that run for good."""
UNWRITTEN = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EBADF, errno.EIO})
"""What writing to a standard stream fails with, besides EPIPE."""
PLUGIN = "kubectl-ctxp"
"""The name under which kubectl finds this program as `kubectl ctxp`."""


def build_parser(prog: str, first: str = "") -> argparse.ArgumentParser:
    """The parser of all commands; `prog` is what people call the program, `first` the first word that follows it.

    Of those that run for good only the one in question: the others take 3 MiB.
    """
    parser = CommandParser(
        prog=prog, description="Context decides who gets the CPU.", epilog=exit_codes.described("COMMAND")
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the installed version and exit")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    only = first.replace("-", "_")
    for command in (only,) if only in IN_THE_CLUSTER else (*ON_THE_CLUSTER, *ON_THE_DESK, *IN_THE_CLUSTER):
        import_module(f"contextpolicy.commands.{command}").add(subparsers)
    for name, own in subparsers.choices.items():
        own.epilog = "\n\n".join([*([own.epilog] if own.epilog else []), exit_codes.described(name)])
    return parser


class _Version(argparse.Action):
    """Looks the version up when it is asked for: that reads files."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        sys.stdout.write(f"{parser.prog} {version('contextpolicy')}\n")
        parser.exit()


def complete() -> int:
    """The program `kubectl_complete-ctxp`, which kubectl asks what may follow `kubectl ctxp`."""
    return completion.reply(build_parser("contextpolicy"), sys.argv[1:], directive=True)


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run the command, print errors without a traceback; returns the exit code."""
    if argv is None:
        _open_closed_streams()
        if isinstance(sys.stderr, io.TextIOWrapper):
            encoding, errors = sys.stderr.encoding, sys.stderr.errors
            sys.stderr = _LossyErrors(sys.stderr.detach(), encoding, errors, line_buffering=True)
    try:
        code = _run(argv)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        _flush_or_discard()
        return READER_GONE
    except ContextPolicyError as error:
        return _failed(str(error))
    except OSError as error:
        _flush_or_discard()
        unwritten = error.filename is None and error.errno in UNWRITTEN
        return _failed(f"contextpolicy: standard output: {error.strerror}" if unwritten else f"contextpolicy: {error}")
    return code


def _run(argv: list[str] | None) -> int:
    words = sys.argv[1:] if argv is None else argv
    if words[:1] == ["__complete"]:
        return completion.reply(build_parser("contextpolicy"), words[1:])
    called = os.path.basename(sys.argv[0]) if argv is None else "contextpolicy"  # noqa: PTH119 - a name, not a path
    parser = build_parser("kubectl ctxp" if called == PLUGIN else "contextpolicy", *words[:1])
    try:
        arguments = parser.parse_args(words)
    except SystemExit:
        sys.stdout.flush()  # help that could not be written must not count as success
        raise
    return int(arguments.main(arguments))


class _LossyErrors(io.TextIOWrapper):
    """Standard error on a disk that may be full: what would go there is lost, and the exit code stays."""

    def write(self, text: str) -> int:
        with suppress(OSError):
            super().write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()


def _open_closed_streams() -> None:
    """Give closed standard streams a place, which no file that is opened later may take.

    What would go to a closed standard output fails, as on a full disk; what would go to standard error is lost.
    """
    if sys.stdin is None:
        sys.stdin = os.fdopen(os.open(os.devnull, os.O_RDONLY))
    if sys.stdout is None:
        sys.stdout = os.fdopen(os.open(os.devnull, os.O_RDONLY), "w")
    if sys.stderr is None:
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")


def _flush_or_discard() -> None:
    """Python flushes stdout once more on exit and would report a second error: that goes nowhere then."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _failed(message: str) -> int:
    with suppress(OSError):
        print(message, file=sys.stderr, flush=True)
    return FAILED
