"""All paths side by side: each round takes every path once, so that whatever disturbs one disturbs all."""

from __future__ import annotations

import time
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from tests.bench.reaction.docker_update import DockerRequest, DockerUpdate
from tests.bench.reaction.dockerd import Docker, DockerError
from tests.bench.reaction.figures import AGENT, IDLE, RESIZE, SATURATED
from tests.bench.reaction.operated import Operated
from tests.bench.reaction.patch import BarePatch, KubectlPatch
from tests.bench.reaction.site import AGENT as AGENT_NAMESPACE
from tests.bench.reaction.site import PLAIN, SPARE, say
from tests.bench.reaction.stopwatch import MissedError
from tests.bench.reaction.write import DirectWrite

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import zenoh

    from tests.bench.reaction.figures import Reaction
    from tests.bench.reaction.journal import Journal
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch

SIZES = (1, 8, 30)
NODES = (IDLE, SATURATED)
FIXED = ("written", "patched", "commanded")
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
    """The contenders that stay, and those that are made again for each number of pods."""

    def __init__(
        self, site: Site, stopwatch: Stopwatch, journal: Journal, problems: dict[str, Any], rounds: int
    ) -> None:
        self._site, self._stopwatch, self._journal, self._problems = site, stopwatch, journal, problems
        self._rounds = rounds

    def measure(self, buses: dict[str, zenoh.Session]) -> None:
        """Each case that the journal has not got. Pods join as they are needed: each of them costs the kubelet time."""
        sizes = [size for size in SIZES if self._journal.left_of(step(node, size) for node in NODES)]
        if not sizes:
            return
        self._site.pods(SPARE, FIXED)
        self._site.load()
        with ExitStack() as stack:
            fixed = self._fixed(stack)
            for size in sizes:
                with self._sized(buses, size) as sized:
                    contenders = [*fixed, *sized]
                    self._journal.once(step(IDLE, size), lambda: self._idle(size, contenders))  # noqa: B023
                    self._journal.once(step(SATURATED, size), lambda: self._saturated(contenders))  # noqa: B023

    def _fixed(self, stack: ExitStack) -> list[Contender]:
        written, patched, commanded = FIXED
        groups = self._site.groups[SPARE]
        made: list[Contender] = [
            DirectWrite(groups[written], self._stopwatch),
            BarePatch(SPARE, {patched: groups[patched]}, self._stopwatch),
            KubectlPatch(SPARE, commanded, groups[commanded], self._stopwatch),
        ]
        try:
            docker = stack.enter_context(Docker())
            made += [DockerUpdate(docker, self._stopwatch), DockerRequest(docker, self._stopwatch)]
        except DockerError as error:
            self._problems["unmeasured"]["docker update"] = str(error)
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

    def _idle(self, size: int, contenders: list[Contender]) -> list[Reaction]:
        for number in range(-WARM_UP, 0):
            self._round(rotated(contenders, number))
        found = []
        for number in range(self._rounds * (KEY_TIMES if size == KEY_SIZE else 1)):
            self._site.quiet.wait()
            found += self._round(rotated(contenders, number))
        return found

    def _saturated(self, contenders: list[Contender]) -> list[Reaction]:
        found: list[Reaction] = []
        while (left := self._rounds - len(found) // len(contenders)) > 0:
            say(f"{left} rounds left")
            self._site.quiet.wait()
            found += self._stretch(contenders, left)
            time.sleep(RESTING)
        return found

    def _stretch(self, contenders: list[Contender], rounds: int) -> list[Reaction]:
        """As many rounds as one stretch of work lasts."""
        self._site.saturate(on=True)
        until = time.monotonic() + WORKING
        found: list[Reaction] = []
        try:
            for number in range(rounds):
                found += self._round(rotated(contenders, number))
                if time.monotonic() > until:
                    break
        finally:
            self._site.saturate(on=False)
        return found

    def _round(self, contenders: Sequence[Contender]) -> list[Reaction]:
        self._stopwatch.forget()
        return [self._reaction(contender) for contender in contenders]

    def _reaction(self, contender: Contender) -> Reaction:
        time.sleep(PAUSE)
        try:
            return {"path": contender.name, "stages": contender.go()}
        except MissedError as error:
            say(f"{contender.name}: {error}")
            return {"path": contender.name, "missed": str(error)}


def step(node: str, size: int) -> str:
    """The name of a case in the journal."""
    return f"table: {size} pods, {node} node"


def rotated(contenders: list[Contender], number: int) -> list[Contender]:
    """Another one first in each round: what one leaves in the caches must not always meet the same next one."""
    first = number % len(contenders)
    return contenders[first:] + contenders[:first]


def operated(site: Site, stopwatch: Stopwatch, namespace: str, bus: zenoh.Session, names: list[str]) -> Operated:
    """One of our paths, its policy in force for these pods."""
    path = Operated({PLAIN: RESIZE, AGENT_NAMESPACE: AGENT}[namespace], bus, namespace, stopwatch)
    path.begin(site.govern(namespace, names))
    return path
