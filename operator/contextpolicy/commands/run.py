"""`contextpolicy run`: the operator."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from contextpolicy import settings

if TYPE_CHECKING:
    import argparse


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "run",
        help="run the operator",
        description="Run the operator: watch ContextPolicy objects and sensor streams, resize the tasks' pods. "
        "Settings come from the environment: ZENOH_CONNECT, WATCH_NAMESPACES, HEALTH_PORT, METRICS_PORT, "
        "LOG_FORMAT, LOG_LEVEL.",
    )
    parser.set_defaults(main=main)


def main(_: argparse.Namespace) -> int:
    """Run until SIGTERM."""
    from contextpolicy import operation

    operation.run(settings.read(os.environ))
    return 0
