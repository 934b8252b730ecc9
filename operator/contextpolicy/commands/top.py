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

from contextpolicy.commands.bus_arguments import add_credentials, connect
from contextpolicy.commands.cluster_access import add_cluster, api_server
from contextpolicy.commands.explain import PATIENCE, NoAnswerError, visit
from contextpolicy.commands.operator_access import all_boards
from contextpolicy.commands.operator_pods import namespace_of_board
from contextpolicy.commands.structured_output import SCHEMA, structured
from contextpolicy.commands.terminal import columns

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    import zenoh

    from contextpolicy.bus.view import BusView

LONGEST_QUEUE = 1000
"""Messages that wait for a slow terminal; beyond that the oldest are dropped."""
WIDE = 200
"""Columns of what is written to a file."""
TICK = 1.0
"""Seconds between redraws when nothing arrives, because the ages on the screen grow."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "top",
        help="watch what the policies decide",
        description="Show the plans on the decision bus as they are made: contexts, cause, and each task's weight and "
        "share, with the stage of its containers: planned, accepted by the API, in force on the node; the limits in "
        "force, CPU used and throttled (as the node agents measure it), the streams' ages, and reaction times.",
    )
    parser.add_argument(
        "--connect",
        type=connect,
        metavar="ENDPOINTS",
        default=os.environ.get("ZENOH_CONNECT") or None,
        help="routers such as tcp/HOST:7447 (default: ZENOH_CONNECT, else through the cluster, with kubectl)",
    )
    add_credentials(parser)
    parser.add_argument("--once", action="store_true", help="show the plans in force, and exit")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("-n", "--namespace", metavar="NS", help="policies of this namespace only")
    where.add_argument("-A", "--all-namespaces", action="store_true", help="policies of every namespace (default)")
    add_cluster(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FORMAT",
        choices=("table", "json", "yaml"),
        default="table",
        help="table (default), json or yaml; json is one line per message, yaml one document",
    )
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Show what is in force, then every change, until interrupted."""
    from contextpolicy.bus.view import BusView

    view = BusView()
    try:
        if arguments.connect is None:
            with api_server(arguments) as api, all_boards(api, arguments, arguments.namespace) as boards:
                _through_the_cluster(arguments, lambda: _of(arguments, boards()), view)
            return 0
        with visit(arguments.connect, arguments.credentials) as session:
            if arguments.once:
                _show_once(arguments, session, view)
            else:
                _follow(arguments, session, view)
    except KeyboardInterrupt:  # how a person ends it, but for what ends by itself
        if arguments.once:
            raise
    return 0


def _of(arguments: argparse.Namespace, boards: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The boards of the namespace that is asked for."""
    return [one for one in boards if arguments.namespace in (None, namespace_of_board(one))]


def _keys(arguments: argparse.Namespace, *topics: str) -> list[str]:
    return [f"contextpolicy/{arguments.namespace or '*'}/*/{topic}" for topic in topics]


def _line(content: Mapping[str, Any], output: str) -> str:
    """One message: a line of JSON, or a YAML document."""
    return (
        f"---\n{structured(content, output)}" if output == "yaml" else json.dumps({"schemaVersion": SCHEMA, **content})
    )


def _through_the_cluster(
    arguments: argparse.Namespace, boards: Callable[[], Sequence[Mapping[str, Any]]], view: BusView
) -> None:
    """Poll the operator; a rate of use takes two answers."""
    if arguments.once:
        boards()
        time.sleep(TICK)
        _take_all(view, boards())
        _print(arguments, view)
    elif arguments.output != "table":
        shown: dict[str, Any] = {}
        while True:
            _take_all(view, boards())
            for name, policy in sorted(view.policies.items()):
                line = policy.as_json()
                if shown.get(name) != line:
                    shown[name] = line
                    print(_line(line, arguments.output), flush=True)
            time.sleep(TICK)
    else:
        _show(arguments, view, lambda: _take_all(view, boards()), lambda: time.sleep(TICK))


def _take_all(view: BusView, boards: Iterable[Mapping[str, Any]]) -> None:
    known = {str(board["policy"]): board for board in boards}
    for gone in (view.policies.keys() | view.boards.keys()) - known.keys():
        view.forget(gone)
    for board in known.values():
        view.take_board(board)


def _show_once(arguments: argparse.Namespace, session: zenoh.Session, view: BusView) -> None:
    for key, payload in _answers(session, *_keys(arguments, "plan")):
        view.take(key, payload)
    if not view.policies:
        raise NoAnswerError(f"no plans at {arguments.connect}: check that the operator is running and has a policy")
    _ask_boards(session, view, *_keys(arguments, "board"))
    _print(arguments, view)


def _print(arguments: argparse.Namespace, view: BusView) -> None:
    if arguments.output != "table":
        for _, policy in sorted(view.policies.items()):
            print(_line(policy.as_json(), arguments.output))
        return
    from rich.console import Console

    from contextpolicy.bus.view_tables import live

    console = Console(width=columns() or WIDE)
    console.print(live(view, time.time(), console.width))


def _follow(arguments: argparse.Namespace, session: zenoh.Session, view: BusView) -> None:
    """Subscribe first, then query: no plan is missed in between, and the view puts them in order."""
    mailbox: deque[tuple[str, bytes | None]] = deque(maxlen=LONGEST_QUEUE)
    arrived = Event()
    listeners = [
        session.declare_subscriber(key, _post(mailbox, arrived)) for key in _keys(arguments, "plan", "applied")
    ]
    mailbox.extend(_answers(session, *_keys(arguments, "plan")))
    arrived.set()
    try:
        if arguments.output != "table":
            _print_lines(arguments, view, mailbox, arrived)
        else:
            _draw(arguments, session, view, (mailbox, arrived))
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


def _ask_boards(session: zenoh.Session, view: BusView, key: str) -> None:
    """No board of an operator that does not answer: an old one would look current."""
    view.boards.clear()
    for _, payload in _answers(session, key):
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


def _print_lines(
    arguments: argparse.Namespace, view: BusView, mailbox: deque[tuple[str, bytes | None]], arrived: Event
) -> None:
    while True:
        arrived.wait()
        # Cleared before the mailbox is read: a message that comes meanwhile sets it again.
        arrived.clear()
        for change in _changes(view, mailbox):
            print(_line(change, arguments.output), flush=True)


def _draw(
    arguments: argparse.Namespace,
    session: zenoh.Session,
    view: BusView,
    post: tuple[deque[tuple[str, bytes | None]], Event],
) -> None:
    """A burst of messages is drawn once, in its last state."""
    mailbox, arrived = post

    def take() -> None:
        arrived.clear()
        for _ in _changes(view, mailbox):
            pass
        _ask_boards(session, view, *_keys(arguments, "board"))

    _show(arguments, view, take, lambda: arrived.wait(TICK))


def _show(arguments: argparse.Namespace, view: BusView, take: Callable[[], None], wait: Callable[[], object]) -> None:
    if sys.stdout.isatty():
        _redraw(view, take, wait)
    else:
        _append(arguments, view, take, wait)


def _redraw(view: BusView, take: Callable[[], None], wait: Callable[[], object]) -> None:
    from rich.live import Live

    from contextpolicy.bus.view_tables import live

    with Live(auto_refresh=False) as screen:
        while True:
            take()
            screen.update(live(view, time.time(), screen.console.width), refresh=True)
            wait()


def _append(arguments: argparse.Namespace, view: BusView, take: Callable[[], None], wait: Callable[[], object]) -> None:
    """Where nothing can be redrawn: print the tables again after each change."""
    last = None
    while True:
        take()
        shown = {name: policy.as_json() for name, policy in view.policies.items()}, set(view.boards)
        if shown != last:
            last = shown
            _print(arguments, view)
            sys.stdout.flush()
        wait()
