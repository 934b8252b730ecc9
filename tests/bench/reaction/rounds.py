"""All paths side by side: each round takes every path once, so that whatever disturbs one disturbs all."""

from __future__ import annotations

import time
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from tests.bench.reaction.docker_update import DockerRequest, DockerUpdate
from tests.bench.reaction.dockerd import Docker, DockerError
from tests.bench.reaction.figures import AGENT, IDLE, RESIZE, SATURATED
from tests.bench.reaction.operated import Operated
from tests.bench.reaction.patch import BarePatch
from tests.bench.reaction.site import AGENT as AGENT_NAMESPACE
from tests.bench.reaction.site import PLAIN, SPARE, say
from tests.bench.reaction.stopwatch import MissedError
from tests.bench.reaction.write import DirectWrite

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import zenoh

    from tests.bench.reaction.figures import Figures
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch

SIZES = (1, 8, 30)
FIXED = ("written", "patched")
"""The pods of the paths that are the same for any number of pods."""
KEY_SIZE, KEY_TIMES = 1, 3
"""The case of the key figures, idle, has that many times the rounds: its goal is 3 ms, and a PATCH takes 6 to 25."""
WARM_UP = 3
"""Rounds that do not count: new pods and connections settle."""
WORKING = 16.0
"""Seconds for which the node is saturated at a stretch: it may have other work to do."""
RESTING = 3.0
PAUSE = 0.3
"""Seconds before each reaction: what the one before it left to do (a status, an event) is over by then."""


class Contender(Protocol):
    """One path to a cgroup."""

    @property
    def name(self) -> str:
        """What the table calls it."""

    def go(self) -> dict[str, float]:
        """React once; milliseconds to each stage."""

    def close(self) -> None:
        """Let go of what it opened."""


class Rounds:
    """The contenders that stay, and those that are made anew for each number of pods."""

    def __init__(self, site: Site, stopwatch: Stopwatch, figures: Figures, rounds: int) -> None:
        self._site, self._stopwatch, self._figures, self._rounds = site, stopwatch, figures, rounds

    def measure(self, buses: dict[str, zenoh.Session]) -> list[dict[str, Any]]:
        """The table; what was measured before a failure is in the figures.

        Pods join as they are needed: each of them costs the kubelet time.
        """
        self._site.pods(SPARE, FIXED)
        self._site.load()
        with ExitStack() as stack:
            fixed = self._fixed(stack)
            for size in SIZES:
                with self._sized(buses, size) as sized:
                    self._both(size, [*fixed, *sized])
        return self._figures.rows()

    def _fixed(self, stack: ExitStack) -> list[Contender]:
        written, patched = FIXED
        groups = self._site.groups[SPARE]
        made: list[Contender] = [
            DirectWrite(groups[written], self._stopwatch),
            BarePatch(SPARE, {patched: groups[patched]}, self._stopwatch),
        ]
        try:
            docker = stack.enter_context(Docker())
            made += [DockerUpdate(docker, self._stopwatch), DockerRequest(docker, self._stopwatch)]
        except DockerError as error:
            self._figures.unmeasured["docker update"] = str(error)
        for contender in made:
            stack.callback(contender.close)
        return made

    @contextmanager
    def _sized(self, buses: dict[str, zenoh.Session], size: int) -> Iterator[list[Contender]]:
        """As many bare PATCHes as the plan has decreases; the operators under a policy for so many pods."""
        names = [f"task-{number}" for number in range(max(2, size))]
        spare = [f"spare-{number}" for number in range(size // 2)]
        with ExitStack() as stack:
            made: list[Contender] = []
            if spare:
                self._site.pods(SPARE, spare)
                groups = self._site.groups[SPARE]
                made.append(BarePatch(SPARE, {name: groups[name] for name in spare}, self._stopwatch))
            for namespace in buses:
                self._site.pods(namespace, names)
            made += [operated(self._site, self._stopwatch, *bus, names) for bus in buses.items()]
            for contender in made:
                stack.callback(contender.close)
            yield made

    def _both(self, size: int, contenders: list[Contender]) -> None:
        rounds = self._rounds * (KEY_TIMES if size == KEY_SIZE else 1)
        say(f"{size} pods, idle node: {rounds} rounds")
        for number in range(-WARM_UP, rounds):
            self._site.quiet.wait()
            self._round(IDLE, size, rotated(contenders, number), counts=number >= 0)
        left = self._rounds
        while left > 0:
            say(f"{size} pods, saturated node: {left} rounds")
            self._site.quiet.wait()
            left -= self._saturated(size, contenders, left)
            time.sleep(RESTING)

    def _saturated(self, size: int, contenders: list[Contender], rounds: int) -> int:
        """As many rounds as one stretch of work lasts."""
        self._site.saturate(on=True)
        until = time.monotonic() + WORKING
        done = 0
        try:
            while done < rounds and time.monotonic() < until:
                self._round(SATURATED, size, rotated(contenders, done))
                done += 1
        finally:
            self._site.saturate(on=False)
        return done

    def _round(self, node: str, size: int, contenders: Sequence[Contender], *, counts: bool = True) -> None:
        self._stopwatch.forget()
        for contender in contenders:
            time.sleep(PAUSE)
            try:
                stages = contender.go()
                if counts:
                    self._figures.note(node, size, contender.name, stages)
            except MissedError as error:
                self._figures.missed.append(f"{node}, {size} pods, {contender.name}: {error}")
                say(self._figures.missed[-1])


def rotated(contenders: list[Contender], number: int) -> list[Contender]:
    """Another one first in each round: what one leaves in the caches must not always meet the same next one."""
    first = number % len(contenders)
    return contenders[first:] + contenders[:first]


def operated(site: Site, stopwatch: Stopwatch, namespace: str, bus: zenoh.Session, names: list[str]) -> Operated:
    """One of our paths, its policy in force for these pods."""
    path = Operated({PLAIN: RESIZE, AGENT_NAMESPACE: AGENT}[namespace], bus, namespace, stopwatch)
    path.begin(site.govern(namespace, names))
    return path
