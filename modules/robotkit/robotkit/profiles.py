"""`python -m robotkit.profiles > profiles.json`: collect the profiles of all running tasks, for `simulate`."""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from robotkit import json_text
from robotkit.errors import ConfigurationError
from robotkit.session import credentials, endpoints, open_session

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import zenoh

PATIENCE_S = 10.0
KEY = "robot/*/profile"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the profiles of all tasks that answer; exit code 1 when there is none."""
    options = _parser().parse_args(arguments)
    try:
        addresses = endpoints({"ZENOH_CONNECT": options.connect})
        with open_session(addresses, threading.Event(), secret=credentials(os.environ)) as session:
            answers = [] if session is None else list(_ask(session))
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    if not answers:
        sys.stderr.write(f"{KEY}: no answer within {PATIENCE_S:g} s: check that the modules are running\n")
        return 1
    sys.stdout.write(json.dumps(document(answers, datetime.now(UTC)), indent=1) + "\n")
    for task in idle(answers):
        sys.stderr.write(f"note: {task} has not processed any input yet: it can't be predicted\n")
    return 0


def document(answers: Iterable[dict[str, Any]], now: datetime) -> dict[str, Any]:
    """One file from the profiles of several tasks (see modules/robotkit/profiles.schema.json)."""
    tasks = {str(answer["task"]): answer for answer in answers}
    return {"measured": now.isoformat(timespec="seconds"), "tasks": dict(sorted(tasks.items()))}


def idle(answers: Iterable[dict[str, Any]]) -> list[str]:
    """The tasks that take inputs and had none."""
    return [
        str(answer["task"])
        for answer in answers
        if answer["inputs"] and not any(own["done"] for own in answer["inputs"].values())
    ]


def _ask(session: zenoh.Session) -> Iterable[dict[str, Any]]:
    for reply in session.get(KEY, timeout=PATIENCE_S):
        if reply.ok is not None:
            yield json_text.loads(reply.ok.payload.to_bytes())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m robotkit.profiles", description=__doc__)
    parser.add_argument(
        "--connect", default=os.environ.get("ZENOH_CONNECT", ""), help="router addresses ($ZENOH_CONNECT)"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
