"""`contextpolicy top`: what every policy decides, live."""

from __future__ import annotations

import json
import os
import sys
import time
from collections import deque
from contextlib import suppress
from threading import Event
from typing import TYPE_CHECKING, Any

from contextpolicy.commands.cluster_access import api_server, operator
from contextpolicy.commands.credentials import add_credentials
from contextpolicy.commands.explain import PATIENCE, NoAnswerError, visit

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    import zenoh

    from contextpolicy.bus.view import BusView

PLANS, STEPS, BOARDS = (f"contextpolicy/*/*/{topic}" for topic in ("plan", "applied", "board"))
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
        "share, with how far its containers are: planned, accepted by the API, in force on the node; the limits in "
        "force, what is used and throttled (as the node agents measure it), the streams' ages, and reaction times.",
    )
    parser.add_argument(
        "--connect",
        metavar="ENDPOINTS",
        default=os.environ.get("ZENOH_CONNECT") or None,
        help="the router, tcp/HOST:7447 (default: ZENOH_CONNECT, else through the cluster, with kubectl)",
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
        if arguments.connect is None:
            with api_server() as api, operator(api) as ask:
                _through_the_cluster(arguments, lambda: ask("boards"), view)
            return 0
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


def _through_the_cluster(
    arguments: argparse.Namespace, boards: Callable[[], Sequence[Mapping[str, Any]]], view: BusView
) -> None:
    """Ask the operator again and again; a rate of use takes two answers."""
    if arguments.once:
        boards()
        time.sleep(TICK)
        _take_all(view, boards())
        _print(arguments, view)
    elif arguments.output == "json":
        told: dict[str, Any] = {}
        while True:
            _take_all(view, boards())
            for name, policy in sorted(view.policies.items()):
                line = policy.as_json()
                if told.get(name) != line:
                    told[name] = line
                    print(json.dumps(line), flush=True)
            time.sleep(TICK)
    else:
        _redraw(view, lambda: _take_all(view, boards()), lambda: time.sleep(TICK))


def _take_all(view: BusView, boards: Iterable[Mapping[str, Any]]) -> None:
    known = {str(board["policy"]): board for board in boards}
    for gone in (view.policies.keys() | view.boards.keys()) - known.keys():
        view.forget(gone)
    for board in known.values():
        view.take_board(board)


def _show_once(arguments: argparse.Namespace, session: zenoh.Session, view: BusView) -> None:
    for key, payload in _answers(session, PLANS):
        view.take(key, payload)
    if not view.policies:
        raise NoAnswerError(f"nobody at {arguments.connect} makes plans: is the operator running, is there a policy?")
    _ask_boards(session, view)
    _print(arguments, view)


def _print(arguments: argparse.Namespace, view: BusView) -> None:
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
    mailbox.extend(_answers(session, PLANS))
    arrived.set()
    try:
        if arguments.output == "json":
            _print_lines(view, mailbox, arrived)
        else:
            _draw(session, view, mailbox, arrived)
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


def _ask_boards(session: zenoh.Session, view: BusView) -> None:
    for _, payload in _answers(session, BOARDS):
        with suppress(ValueError, RecursionError):  # on an open bus anybody may answer
            view.take_board(json.loads(payload))


def _answers(session: zenoh.Session, key: str) -> Iterator[tuple[str, bytes]]:
    for reply in session.get(key, timeout=PATIENCE):
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


def _draw(session: zenoh.Session, view: BusView, mailbox: deque[tuple[str, bytes | None]], arrived: Event) -> None:
    """A burst of messages is drawn once, in its last state."""

    def take() -> None:
        arrived.clear()
        for _ in _changes(view, mailbox):
            pass
        _ask_boards(session, view)

    _redraw(view, take, lambda: arrived.wait(TICK))


def _redraw(view: BusView, take: Callable[[], None], wait: Callable[[], object]) -> None:
    from rich.live import Live

    from contextpolicy.bus.view import live

    with Live(auto_refresh=False) as screen:
        while True:
            take()
            screen.update(live(view, time.time()), refresh=True)
            wait()
