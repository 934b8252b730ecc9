"""`python -m robotkit.ask TASK profile|health`: print a running task's profile or health as JSON."""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
from typing import TYPE_CHECKING

from robotkit.errors import ConfigurationError
from robotkit.session import credentials, endpoints, open_session

if TYPE_CHECKING:
    from collections.abc import Sequence

    import zenoh

PATIENCE_S = 5.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the answer; exit code 1 when there is none."""
    options = _parser().parse_args(arguments)
    key = f"robot/{options.task}/{options.what}"
    try:
        addresses = endpoints({"ZENOH_CONNECT": options.connect})
        with open_session(addresses, threading.Event(), secret=credentials(os.environ)) as session:
            answer = None if session is None else _ask(session, key, options.what)
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    if answer is None:
        sys.stderr.write(f"{key}: no answer within {PATIENCE_S:g} s: check that the module is running\n")
        return 1
    sys.stdout.write(json.dumps(json.loads(answer), indent=2) + "\n")
    return 0


def _ask(session: zenoh.Session, key: str, what: str) -> bytes | None:
    if what == "profile":
        replies = session.get(key, timeout=PATIENCE_S)
        return next((reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None), None)
    heard: list[bytes] = []
    arrived = threading.Event()

    def hear(sample: zenoh.Sample) -> None:
        heard.append(sample.payload.to_bytes())
        arrived.set()

    session.declare_subscriber(key, hear)
    return heard[0] if arrived.wait(PATIENCE_S) else None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m robotkit.ask", description=__doc__)
    parser.add_argument("task", help="the task's name")
    parser.add_argument("what", choices=("profile", "health"))
    parser.add_argument(
        "--connect", default=os.environ.get("ZENOH_CONNECT", ""), help="router addresses ($ZENOH_CONNECT)"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
