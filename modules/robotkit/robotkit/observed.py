"""The inputs of a node that is only observed: which of them it has answered, and when. Pure: time is an argument.

In ROS an answer has the header's stamp of the message that led to it. So an input waits until an answer with its stamp
comes. Answers are counted as if the node made one after the other.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from robotkit.profile import Run

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotkit.module import Module
    from robotkit.profile import Profile

KEPT_NS = 60_000_000_000
"""How long a node that leaves inputs out on purpose may take for an answer; twice its deadline if that is more."""
MOST = 4096
"""Inputs of which such an answer may be; older ones are forgotten."""


class Heard(NamedTuple):
    """A message that reached the node; times are in ns since 1970."""

    stamp: int
    """Of its header."""
    published: int
    received: int


class Observed:
    """What a node takes and has not answered; its runs go into a profile.

    `cpu` gives the CPU time that the node has used, in ns. `answers_all` is false for a node that leaves inputs out on
    purpose: then only what it answers counts, and nothing waits; but each input is remembered for longer than its
    deadline, or a late answer would look like one to nothing.
    """

    def __init__(self, module: Module, profile: Profile, cpu: Callable[[], int], *, answers_all: bool = True) -> None:
        self.dropped = dict.fromkeys(module.inputs, 0)
        self.shared = dict.fromkeys(module.inputs, 0)
        self.matched = self.strange = 0
        """Answers with the stamp of an input, and others."""
        self._profile, self._cpu, self._answers_all = profile, cpu, answers_all
        most = None if answers_all else MOST
        # If it answers all, the first is the one that the node works on, and the others are in its queue.
        self._queues: dict[str, deque[Heard]] = {name: deque(maxlen=most) for name in module.inputs}
        self._depths = {name: own.depth for name, own in module.inputs.items()}
        self._kept = max(KEPT_NS, round(2e9 * (module.needs.deadline or 0.0)))
        self._finished, self._used = 0, cpu()
        self._lock = threading.Lock()

    @property
    def unfinished(self) -> list[tuple[str, int]]:
        """Name and time of arrival of each input that waits for its answer: the newest `depth`, and one in progress."""
        with self._lock:
            waiting = self._queues.items() if self._answers_all else ()
            return [(name, heard.received) for name, queue in waiting for heard in queue]

    def came(self, name: str, heard: Heard) -> None:
        """Note an input; of a full queue the oldest is lost, as in a subscription of ROS, but not the one in work."""
        with self._lock:
            queue = self._queues[name]
            if not self._answers_all:
                while queue and heard.received - queue[0].received > self._kept:
                    queue.popleft()
            elif len(queue) > self._depths[name]:
                del queue[1]
                self.dropped[name] += 1
            queue.append(heard)

    def answered(self, stamp: int | None, now: int) -> None:
        """Note an answer: it ends the input with this stamp, and passes over the older ones. None: it has no stamp."""
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

    def _end(self, name: str, stamp: int | None, now: int) -> None:
        queue = self._queues[name]
        while (heard := queue.popleft()).stamp != stamp:
            self.dropped[name] += self._answers_all
        used = self._cpu()
        started = min(max(heard.received, self._finished), now)
        self._profile.inputs[name].add(Run(heard.published, heard.received, started, now, used - self._used))
        self._finished, self._used = now, used
