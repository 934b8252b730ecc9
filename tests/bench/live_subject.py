"""One subject of the live benchmark: `python -m tests.bench.live_subject KIND ENDPOINT`, asked on its standard input.

Each line asks for the CPU time of the process so far and, of an operator, when each plan of `SHARES` was last in force
(monotonic seconds). The engine is asked to work through samples instead.
"""

# ruff: noqa: T201 - it answers on its standard output

from __future__ import annotations

import json
import sys
import time
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any

from contextpolicy.bus.session import open_visitor
from contextpolicy.planning.planner import Planner
from contextpolicy.policy import parsing
from contextpolicy.streams.decoding import Decoder
from tests.bench.live_case import KEYS, SHARES, steady, steady_policy, stormy_policy
from tests.bench.live_operator import LiveOperator
from tests.planning.builders import on_node
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    import zenoh


class Bare:
    """A callback that takes the payload."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._subscriber = session.declare_subscriber(key, self._take)

    def ask(self) -> dict[str, Any]:
        return {"cpu": time.process_time()}

    def _take(self, sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()


class HandOver(Bare):
    """The cheapest hand-over that Python has."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._queue: SimpleQueue[bytes] = SimpleQueue()
        Thread(target=self._work, daemon=True).start()
        super().__init__(session, key)

    def _take(self, sample: zenoh.Sample) -> None:
        self._queue.put(sample.payload.to_bytes())

    def _work(self) -> None:
        while True:
            self._queue.get()


class Operator:
    """The whole runtime."""

    def __init__(self, session: zenoh.Session, body: dict[str, Any]) -> None:
        self._operator = LiveOperator(session, body)

    def ask(self) -> dict[str, Any]:
        limits = self._operator.cluster.in_force
        in_force = {last: limits.get(("slam", share), 0.0) for last, share in SHARES.items()}
        return {
            "cpu": time.process_time(),
            "in_force": [in_force[last] for last in sorted(in_force)],
        }


class Engine:
    """The same samples, from memory: CPU time of the thread, between its sleeps."""

    def __init__(self) -> None:
        policy = parsing.parse(steady_policy())
        self._decoder, self._planner = Decoder(policy.streams[0]), Planner(policy, Quiet(), {})
        self._planner.start(time.time())
        self._planner.handle(on_node("slam", "speech"), time.time())

    def ask(self, rate: float, count: int) -> dict[str, float]:
        spent, begin = 0, time.monotonic()
        for number in range(count):
            payload = steady(number)
            time.sleep(max(0.0, begin + number / rate - time.monotonic()))
            before = time.thread_time_ns()
            self._planner.handle(self._decoder.decode(payload), time.time())
            spent += time.thread_time_ns() - before
        return {"us": spent / count / 1e3}


def main() -> None:
    kind, endpoint = sys.argv[1:]
    if kind == "engine":
        subject: Any = Engine()
    else:
        session = open_visitor([endpoint], patience=5.0)
        match kind:
            case "bare":
                subject = Bare(session, KEYS[kind])
            case "hand-over":
                subject = HandOver(session, KEYS[kind])
            case "operator":
                subject = Operator(session, steady_policy())
            case _:
                subject = Operator(session, stormy_policy())
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(subject.ask(**json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
