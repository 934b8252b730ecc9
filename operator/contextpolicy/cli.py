"""The command line: `contextpolicy COMMAND`.

Exit codes: 0 success, 1 the answer is no (a refused policy, an expectation that does not hold), 2 it could not run (an
unusable file, wrong usage, no answer), 141 the reader of the output is gone (128 + SIGPIPE).
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from importlib import import_module

from contextpolicy.commands import completion
from contextpolicy.errors import ContextPolicyError

ON_THE_CLUSTER = (
    *("status", "top", "explain", "why_not", "force", "mode", "shadow", "adopt", "doctor", "record", "restore"),
)
ON_THE_DESK = ("validate", "simulate", "suggest", "skeleton", "graph", "completion")
IN_THE_CLUSTER = ("run", "router", "agent", "agent_supervisor")
"""The modules of commands that run for good."""
PLUGIN = "kubectl-ctxp"
"""The name under which kubectl finds this program as `kubectl ctxp`."""


def build_parser(prog: str, first: str = "") -> argparse.ArgumentParser:
    """The parser of all commands; `prog` is what people call the program, `first` the first word that follows it.

    Of those that run for good only the one in question: the others take 3 MiB.
    """
    parser = argparse.ArgumentParser(prog=prog, description="Context decides who gets the CPU.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show the installed version and exit")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    only = first.replace("-", "_")
    for command in (only,) if only in IN_THE_CLUSTER else (*ON_THE_CLUSTER, *ON_THE_DESK, *IN_THE_CLUSTER):
        import_module(f"contextpolicy.commands.{command}").add(subparsers)
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
    words = sys.argv[1:] if argv is None else argv
    if words[:1] == ["__complete"]:
        return completion.reply(build_parser("contextpolicy"), words[1:])
    called = os.path.basename(sys.argv[0]) if argv is None else "contextpolicy"  # noqa: PTH119 - a name, not a path
    parser = build_parser("kubectl ctxp" if called == PLUGIN else "contextpolicy", *words[:1])
    arguments = parser.parse_args(words)
    try:
        code = int(arguments.main(arguments))
        sys.stdout.flush()
    except ContextPolicyError as error:
        print(error, file=sys.stderr)
        return 2
    except BrokenPipeError:
        # Python flushes stdout once more on exit and would print a second error: give it somewhere to write.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    return code
