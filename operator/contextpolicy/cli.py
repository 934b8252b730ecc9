"""The command line: `contextpolicy COMMAND`.

Exit codes: 0 success, 1 the answer is no (a refused policy, an expectation that does not hold), 2 it could not run (an
unusable file, wrong usage, no answer), 141 the reader of the output is gone (128 + SIGPIPE).
"""

from __future__ import annotations

import argparse
import os
import signal
import sys

from contextpolicy.commands import (
    agent,
    explain,
    graph,
    restore,
    router,
    run,
    simulate,
    skeleton,
    suggest,
    top,
    validate,
)
from contextpolicy.errors import ContextPolicyError


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run the command, print errors without a traceback; returns the exit code."""
    parser = argparse.ArgumentParser(prog="contextpolicy", description="Context decides who gets the CPU.")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in (run, router, agent, simulate, suggest, validate, skeleton, explain, graph, top, restore):
        command.add(subparsers)
    arguments = parser.parse_args(argv)
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
