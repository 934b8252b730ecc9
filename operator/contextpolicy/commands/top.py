"""`contextpolicy top`: what every policy decides, live."""

from __future__ import annotations

import json
import os
import sys
import time
from collections import deque
from threading import Event
from typing import TYPE_CHECKING, Any

from contextpolicy import settings
from contextpolicy.commands.credentials import add_credentials
from contextpolicy.commands.explain import PATIENCE, NoAnswerError, visit

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator

    import zenoh

    from contextpolicy.bus.view import BusView

PLANS, STEPS = "contextpolicy/*/*/plan", "contextpolicy/*/*/applied"
LONGEST_QUEUE = 1000
"""Messages that wait for a slow terminal; beyond that the oldest are dropped."""
TICK = 1.0
"""Seconds between redraws when nothing arrives, because the ages on the screen grow."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "top",
        help="watch what the policies decide",
        description="Show the plans on the decision bus as they are made: contexts, cause, and each task's weight and "
        "share, with how far its containers are: planned, accepted by the API, in force on the node.",
    )
    parser.add_argument(
        "--connect",
        metavar="ENDPOINTS",
        default=os.environ.get("ZENOH_CONNECT") or settings.DEFAULT_CONNECT,
        help="the router, tcp/HOST:7447 (default: ZENOH_CONNECT, else this machine)",
    )
    add_credentials(parser)
    parser.add_argument("--once", action="store_true", help="show the plans in force and end")
    parser.add_argument(
        "--output", choices=("table", "json"), default="table", help="default: table; json is one line per message"
    )
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Show what is in force, then every change, until interrupted."""
    from contextpolicy.bus.view import BusView

    view = BusView()
    try:
        with visit(arguments.connect, arguments.credentials) as session:
            if arguments.once:
                _show_once(arguments, session, view)
            else:
                _follow(arguments, session, view)
    except KeyboardInterrupt:
        pass  # how a person ends it
    except BrokenPipeError:
        # The pipe's reader is gone, and Python's flush at exit would fail again: give it somewhere to write.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _show_once(arguments: argparse.Namespace, session: zenoh.Session, view: BusView) -> None:
    for key, payload in _plans_in_force(session):
        view.take(key, payload)
    if not view.policies:
        raise NoAnswerError(f"nobody at {arguments.connect} makes plans: is the operator running, is there a policy?")
    if arguments.output == "json":
        for _, policy in sorted(view.policies.items()):
            print(json.dumps(policy.as_json()))
        return
    from rich.console import Console

    from contextpolicy.bus.view import live

    Console().print(live(view, time.time()))


def _follow(arguments: argparse.Namespace, session: zenoh.Session, view: BusView) -> None:
    """Subscribe first, then query: no plan is missed in between, and the view puts them in order."""
    mailbox: deque[tuple[str, bytes | None]] = deque(maxlen=LONGEST_QUEUE)
    arrived = Event()
    listeners = [session.declare_subscriber(key, _post(mailbox, arrived)) for key in (PLANS, STEPS)]
    mailbox.extend(_plans_in_force(session))
    arrived.set()
    try:
        (_print_lines if arguments.output == "json" else _draw)(view, mailbox, arrived)
    finally:
        for listener in listeners:
            listener.undeclare()


def _post(mailbox: deque[tuple[str, bytes | None]], arrived: Event) -> Callable[[zenoh.Sample], None]:
    import zenoh

    def post(sample: zenoh.Sample) -> None:
        withdrawn = sample.kind == zenoh.SampleKind.DELETE
        mailbox.append((str(sample.key_expr), None if withdrawn else sample.payload.to_bytes()))
        arrived.set()

    return post


def _plans_in_force(session: zenoh.Session) -> Iterator[tuple[str, bytes]]:
    for reply in session.get(PLANS, timeout=PATIENCE):
        if reply.ok is not None:
            yield str(reply.ok.key_expr), reply.ok.payload.to_bytes()


def _changes(view: BusView, mailbox: deque[tuple[str, bytes | None]]) -> Iterator[dict[str, Any]]:
    while mailbox:
        change = view.take(*mailbox.popleft())
        if change is not None:
            yield change


def _print_lines(view: BusView, mailbox: deque[tuple[str, bytes | None]], arrived: Event) -> None:
    while True:
        arrived.wait()
        # Cleared before the mailbox is read: a message that comes meanwhile sets it again.
        arrived.clear()
        for change in _changes(view, mailbox):
            print(json.dumps(change), flush=True)


def _draw(view: BusView, mailbox: deque[tuple[str, bytes | None]], arrived: Event) -> None:
    """A burst of messages is drawn once, in its last state."""
    from rich.live import Live

    from contextpolicy.bus.view import live

    with Live(auto_refresh=False) as screen:
        while True:
            arrived.wait(TICK)
            arrived.clear()
            for _ in _changes(view, mailbox):
                pass
            screen.update(live(view, time.time()), refresh=True)
