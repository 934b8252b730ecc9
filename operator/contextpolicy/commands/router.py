"""`contextpolicy router`: a Zenoh router for the robot."""

from __future__ import annotations

import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "router",
        help="run a Zenoh router",
        description="Route between Zenoh clients until SIGTERM.",
    )
    parser.add_argument(
        "--listen", default="tcp/0.0.0.0:7447", help="endpoints, comma separated (default: %(default)s)"
    )
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Route until told to stop."""
    from contextpolicy.bus.session import open_router

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    with open_router(arguments.listen.split(",")):
        print(f"routing at {arguments.listen}", flush=True)
        stop.wait()
    return 0
