"""Who hears what on a bus, in bounded time."""

from __future__ import annotations

from contextlib import suppress
from queue import Empty, Queue

from tests.modules.robotkit.bus import Matching
from tests.waiting import PATIENCE

NEVER = 0.3


class Heard:
    """What a subscriber hears."""

    def __init__(self, session, key):
        self.queue: Queue[str] = Queue()
        self.said: set[str] = set()
        self.subscriber = session.declare_subscriber(key, lambda sample: self.queue.put(sample.payload.to_string()))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.subscriber.undeclare()

    def until(self, session, key, text):
        """Say it until it is heard: a subscription takes a moment to reach the router, and a busy one drops some."""
        self.said.add(text)
        for _ in range(30):
            say(session, key, text)
            with suppress(Empty):
                while (heard := self.next(timeout=1.0)) != text:
                    assert heard in self.said
                return
        raise AssertionError(f"{text} was never heard")

    def next(self, timeout=PATIENCE):
        return self.queue.get(timeout=timeout)

    def nothing(self):
        """Nothing but what was said to it."""
        heard = set()
        with suppress(Empty):
            while True:
                heard.add(self.next(timeout=NEVER))
        assert heard <= self.said


def say(session, key, text):
    """As soon as somebody listens, or the router does not say who does."""
    with session.declare_publisher(key) as publisher:
        Matching(publisher).wait(expected=True)
        publisher.put(text)
