"""The inputs of a node that we only overhear: which of them it has answered, and when. Pure: time comes with them.

In ROS an answer has the header's stamp of the message that led to it. So an input waits until an answer with its stamp
comes. Answers are counted as if the node made one after the other.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from robotkit.profile import Run

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from robotkit.module import Input
    from robotkit.profile import Profile


class Heard(NamedTuple):
    """A message that reached the node; times are in ns since 1970."""

    stamp: int
    """Of its header."""
    published: int
    received: int


class Observed:
    """What a node takes and has not answered; its runs go into a profile.

    `cpu` gives the CPU time that the node has used, in ns. `answers_all` is false for a node that leaves inputs out on
    purpose: then only what it answers counts, and nothing waits.
    """

    def __init__(
        self, inputs: Mapping[str, Input], profile: Profile, cpu: Callable[[], int], *, answers_all: bool = True
    ) -> None:
        self.dropped = dict.fromkeys(inputs, 0)
        self.shared = dict.fromkeys(inputs, 0)
        self.matched = self.strange = 0
        """Answers with the stamp of an input, and others."""
        self._profile, self._cpu, self._answers_all = profile, cpu, answers_all
        # One that the node works on, and those in its queue.
        self._queues: dict[str, deque[Heard]] = {name: deque(maxlen=1 + own.depth) for name, own in inputs.items()}
        self._finished, self._used = 0, cpu()
        self._lock = threading.Lock()

    @property
    def unfinished(self) -> list[tuple[str, int]]:
        """Name and time of arrival of each input that waits for its answer: the newest `depth`, and one in progress."""
        with self._lock:
            waiting = self._queues.items() if self._answers_all else ()
            return [(name, heard.received) for name, queue in waiting for heard in queue]

    def came(self, name: str, heard: Heard) -> None:
        """Note an input; of a full queue the oldest is lost, as in a subscription of ROS."""
        with self._lock:
            queue = self._queues[name]
            self.dropped[name] += self._answers_all and len(queue) == queue.maxlen
            queue.append(heard)

    def answered(self, stamp: int, now: int) -> None:
        """Note an answer: it ends the input with this stamp, and passes over the older ones."""
        with self._lock:
            found = [name for name, queue in self._queues.items() if any(heard.stamp == stamp for heard in queue)]
            self.matched += bool(found)
            self.strange += not found
            for name in found:
                self._end(name, stamp, now)

    def forget(self) -> None:
        """A suspended node answers nothing, and nothing is asked of it."""
        with self._lock:
            for queue in self._queues.values():
                queue.clear()

    def _end(self, name: str, stamp: int, now: int) -> None:
        queue = self._queues[name]
        while (heard := queue.popleft()).stamp != stamp:
            self.dropped[name] += self._answers_all
        used = self._cpu()
        started = min(max(heard.received, self._finished), now)
        self._profile.inputs[name].add(Run(heard.published, heard.received, started, now, used - self._used))
        self._finished, self._used = now, used
