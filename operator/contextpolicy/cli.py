"""The command line: `contextpolicy COMMAND`.

Exit codes: 0 success, 1 the answer is no (an invalid policy, a failed assertion), 2 wrong usage.
"""

from __future__ import annotations

import argparse
import sys

from contextpolicy.commands import agent, explain, graph, restore, router, run, simulate, skeleton, top, validate
from contextpolicy.errors import ContextPolicyError


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run the command, print errors for people."""
    parser = argparse.ArgumentParser(prog="contextpolicy", description="Context decides who gets the CPU.")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in (run, router, agent, simulate, validate, skeleton, explain, graph, top, restore):
        command.add(subparsers)
    arguments = parser.parse_args(argv)
    try:
        return int(arguments.main(arguments))
    except ContextPolicyError as error:
        print(error, file=sys.stderr)
        return 1
