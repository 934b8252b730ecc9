"""One process of the benchmark: `python -m tests.bench.hops.subject KIND ARGUMENT...`, asked on its standard input.

Operator and agent answer with what their stamps noted; relay and writer are the floor: what arrives is passed on, and
written to files that are open. The writer answers with the time of its last write.
"""

# ruff: noqa: T201 - it answers on its standard output

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy import cli
from contextpolicy.bus.session import open_visitor
from contextpolicy.bus.signatures import Signer
from tests.bench.hops.case import IMU, RELAYED, SENT, pods, policy
from tests.bench.hops.stamps import AGENT, OPERATOR, Stamps
from tests.bench.live_operator import LiveOperator, StandInCluster

if TYPE_CHECKING:
    from collections.abc import Callable

    Subject = Callable[..., Any]


def main() -> int:
    kind, *arguments = sys.argv[1:]
    if kind == "agent":
        return _agent()
    endpoint, credentials, *rest = arguments
    made: dict[str, Callable[..., Subject]] = {
        "operator": _operator,
        "sensor": _sensor,
        "relay": _relay,
        "writer": _writer,
    }
    with open_visitor([endpoint], patience=5.0, credentials=Path(credentials)) as session:
        _answer(made[kind](session, *rest))
    return 0


def _answer(subject: Subject) -> None:
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(subject(**json.loads(line))), flush=True)


def _operator(session: zenoh.Session, signing: str, count: str) -> Subject:
    stamps = Stamps(OPERATOR)
    operator = LiveOperator(session, policy(int(count)), StandInCluster(pods(int(count))), Signer(Path(signing)))
    return lambda: [operator, stamps.take()][1]


def _agent() -> int:
    """The command itself, with its settings from the environment; it handles signals, which only a main thread may."""
    stamps = Stamps(AGENT)
    Thread(target=_answer, args=(stamps.take,), daemon=True).start()
    return cli.main(["agent"])


def _sensor(session: zenoh.Session, rate: str) -> Subject:
    """Publishes at this rate (Hz) until the process ends; there is nothing to ask it."""
    publisher = session.declare_publisher(IMU, express=True, congestion_control=zenoh.CongestionControl.DROP)

    def publish() -> None:
        while True:
            publisher.put(b'{"speed": 0.1}')
            time.sleep(1 / float(rate))

    Thread(target=publish, daemon=True).start()
    return lambda: True


def _relay(session: zenoh.Session, size: str) -> Subject:
    plan = b"x" * int(size)
    publisher = session.declare_publisher(RELAYED, express=True, congestion_control=zenoh.CongestionControl.DROP)
    subscribers = [
        session.declare_subscriber(SENT, lambda _: publisher.put(plan)),
        session.declare_subscriber(IMU, lambda sample: sample.payload.to_bytes()),
    ]
    return lambda: bool(subscribers)


def _writer(session: zenoh.Session, *files: str) -> Subject:
    opened = [os.open(file, os.O_WRONLY) for file in files]
    written = [0]

    def write(sample: zenoh.Sample) -> None:
        text = b"%d\n" % (1000 + sample.payload.to_bytes()[0])
        for file in opened:
            os.pwrite(file, text, 0)
        written[0] = time.time_ns()

    subscriber = session.declare_subscriber(RELAYED, write)
    return lambda: written[0] if subscriber else None


if __name__ == "__main__":
    sys.exit(main())
