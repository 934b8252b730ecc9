"""Prompt and Strict on the same load: when limits are in force, how far they overshoot, what the critical task does.

Each sample turns the plan: half of the tasks had all of one core, the critical one not among them; then the other half
has it, the critical task eight times as much as each of the others. As many bare PATCHes to the same limits are sent
at once beside it, while the policy is paused.
"""

from __future__ import annotations

import time
from contextlib import closing, contextmanager
from dataclasses import fields
from statistics import median
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.spec import Enforcement, Transition
from tests.bench.reaction import objects
from tests.bench.reaction.counted_work import CountedWork
from tests.bench.reaction.figures import IDLE, RESIZE, SATURATED, percentile
from tests.bench.reaction.objects import ORIGINAL
from tests.bench.reaction.operated import EXACT, PATIENCE, Operated
from tests.bench.reaction.overshoot import overshoot
from tests.bench.reaction.patch import BarePatch
from tests.bench.reaction.rounds import PAUSE, RESTING
from tests.bench.reaction.site import PLAIN, allocatable, say
from tests.bench.reaction.stopwatch import MissedError
from tests.e2e.cluster import apply, until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import zenoh

    from tests.bench.reaction.counted_work import Measured
    from tests.bench.reaction.journal import Journal
    from tests.bench.reaction.site import Site
    from tests.bench.reaction.stopwatch import Stopwatch
    from timelines.demo.cgroup import Cgroup

    Reaction = dict[str, Any]

SIZES = (2, 8, 30)
NODES = (IDLE, SATURATED)
CRITICAL = "critical"
BARE = "bare PATCHes"
BLOCKS = 2
"""Times that the paths take turns in each case; a turn is half of the rounds."""
WINDOW = 0.2
"""Seconds from the sample in which the critical task's work is counted."""
CAPACITY = 1.0
COLUMNS = (
    "critical_ms",
    "all_ms",
    "overshoot_cores",
    "overshoot_ms",
    "overshoot_core_ms",
    "work_200ms",
    "cpu_ms_200ms",
)


def step(size: int, node: str) -> str:
    """The name of a case in the journal."""
    return f"transition: {size} limits, {node} node"


def steps() -> list[str]:
    """All of them, in order."""
    return [step(size, node) for node in NODES for size in SIZES]


def measure(site: Site, stopwatch: Stopwatch, bus: zenoh.Session, journal: Journal, rounds: int) -> None:
    """Each case that the journal has not got."""
    if not journal.left_of(steps()):
        return
    site.counter(PLAIN, CRITICAL)
    site.load()
    for node, size in ((node, size) for node in NODES for size in SIZES):
        if journal.left_of([step(size, node)]):
            names = [CRITICAL, *(f"task-{number}" for number in range(1, size))]
            site.pods(PLAIN, names[1:])
            case = _Case(site, stopwatch, bus, names, node)
            journal.once(step(size, node), lambda case=case: case.measure(rounds))  # type: ignore[misc]


class _Case:
    """So many limits on an idle or a saturated node."""

    def __init__(self, site: Site, stopwatch: Stopwatch, bus: zenoh.Session, names: list[str], node: str) -> None:
        self._site, self._stopwatch, self._names, self._node = site, stopwatch, names, node
        self._groups = {name: site.groups[PLAIN][name] for name in names}
        self._path = Operated(RESIZE, bus, PLAIN, stopwatch)
        self._work = CountedWork(self._groups[CRITICAL])
        self._plans: list[dict[str, float]] = []
        """The cores of each task in the two plans: the critical task rests, and has its share."""

    def measure(self, rounds: int) -> list[Reaction]:
        """The reactions of all paths, which take turns."""
        made: dict[str, Callable[[], Reaction]] = {
            **dict.fromkeys((Transition.STRICT, Transition.PROMPT), self._turned),
            BARE: self._patched,
        }
        found = []
        try:
            for block in range(BLOCKS):
                for name, act in made.items():
                    self._site.quiet.wait()
                    say(f"{name}, turn {block + 1} of {BLOCKS}")
                    self._prepare(name)
                    found += self._block(name, act, (rounds + block) // BLOCKS)
        finally:
            self._path.close()
            self._work.close()
        return found

    def _block(self, name: str, act: Callable[[], Reaction], rounds: int) -> list[Reaction]:
        with self._busy():
            found = [self._reaction(name, act) for _ in range(rounds)]
        if name == BARE:  # the operator takes what it finds for the pods' own limits
            self._patch(dict.fromkeys(self._names, ORIGINAL))
        return found

    @contextmanager
    def _busy(self) -> Iterator[None]:
        """The critical task works, on a saturated node the others too."""
        self._site.signal(PLAIN, [CRITICAL], on=True)
        if self._node == SATURATED:
            self._site.saturate(on=True)
        try:
            yield
        finally:
            self._site.signal(PLAIN, [CRITICAL], on=False)
            if self._node == SATURATED:
                self._site.saturate(on=False)
                time.sleep(RESTING)

    def _prepare(self, name: str) -> None:
        """The operator moves the limits in this way, or leaves them to bare PATCHes."""
        spec = {"mode": "Paused"} if name == BARE else {"mode": "Enforce", "enforcement": {"transition": name}}
        apply(objects.policy_of(PLAIN, {**_spec(self._names), **spec}))
        if name == BARE:
            until("the policy is paused", lambda: {group.limit() for group in self._groups.values()} == {ORIGINAL})
        else:
            self._path.begin({self._site.identities[PLAIN][name]: group for name, group in self._groups.items()})

    def _reaction(self, name: str, act: Callable[[], Reaction]) -> Reaction:
        self._stopwatch.forget()
        try:
            return {"path": name, **act()}
        except MissedError as error:
            say(f"{name}: {error}")
            return {"path": name, "missed": str(error)}

    def _turned(self) -> Reaction:
        rests = self._path.turn_to(left=True)
        time.sleep(PAUSE)
        work, before = self._work.during(time.time(), WINDOW), self._limits()
        began, wanted = self._path.react()
        self._plans = [rests, {name: wanted[group] for name, group in self._groups.items()}]
        return self._reaction_of(began, before, wanted, work)

    def _patched(self) -> Reaction:
        rests, runs = self._plans
        with closing(BarePatch(PLAIN, self._groups, self._stopwatch)) as patches:
            patches.send(rests)
            time.sleep(PAUSE)
            before, began = self._limits(), time.time()
            work = self._work.during(began, WINDOW)
            patches.send(dict(sorted(runs.items(), key=lambda item: item[1] - before[self._groups[item[0]]])))
            return self._reaction_of(began, before, {self._groups[name]: cores for name, cores in runs.items()}, work)

    def _patch(self, limits: Mapping[str, float]) -> None:
        with closing(BarePatch(PLAIN, self._groups, self._stopwatch)) as patches:
            patches.send(limits)

    def _reaction_of(
        self, began: float, before: Mapping[Cgroup, float], wanted: Mapping[Cgroup, float], work: Measured
    ) -> Reaction:
        moved = {group: cores for group, cores in wanted.items() if abs(cores - before[group]) > EXACT}
        if self._groups[CRITICAL] not in moved:
            raise MissedError(f"{CRITICAL} had the limit before the sample that should bring it")
        seen = self._stopwatch.wait(moved, began, PATIENCE)
        over = overshoot(CAPACITY, before, self._stopwatch.steps(before, began))
        loops, cpu = work.result()
        figures = (
            (seen[self._groups[CRITICAL]] - began) * 1e3,
            (max(seen.values()) - began) * 1e3,
            over.height,
            over.duration * 1e3,
            over.integral * 1e3,
            loops,
            cpu * 1e3,
        )
        return dict(zip(COLUMNS, figures, strict=True))

    def _limits(self) -> dict[Cgroup, float]:
        return {group: group.limit() or 0.0 for group in self._groups.values()}


def _spec(names: list[str]) -> dict[str, Any]:
    resting, running = names[::2], names[1::2]
    heavy = {CRITICAL: {"weight": 8}, **{name: {"suspend": True} for name in running}}
    return {
        "reserve": f"{round((allocatable() - CAPACITY) * 1000)}m",
        "streams": [{"name": "turn", "key": f"{PLAIN}/turn"}],
        "tasks": [objects.task(name) for name in names],
        "contexts": [
            {"name": "left", "when": "turn.left", "tasks": {name: {"suspend": True} for name in resting}},
            {"name": "right", "when": "!turn.left", "tasks": heavy},
        ],
    }


def rows(journal: Journal) -> list[dict[str, Any]]:
    """One row for each case and path: medians, and the 90th percentile of the times."""
    return [
        {"limits": size, "node": node, "path": path, **_row(reactions)}
        for size in SIZES
        for node in NODES
        for path in (Transition.STRICT, Transition.PROMPT, BARE)
        if (reactions := [one for one in journal.found(step(size, node)) if one["path"] == path])
    ]


def _row(reactions: list[Reaction]) -> dict[str, Any]:
    times = {column: [one[column] for one in reactions if "missed" not in one] for column in COLUMNS}
    missed = sum("missed" in one for one in reactions)
    if missed == len(reactions):
        return {**dict.fromkeys(COLUMNS), "critical_ms_p90": None, "all_ms_p90": None, "n": 0, "missed": missed}
    return {
        **{column: round(median(found), 2) for column, found in times.items()},
        **{f"{column}_p90": round(percentile(times[column], 90), 1) for column in COLUMNS[:2]},
        "n": len(times[COLUMNS[0]]),
        "missed": missed,
    }


def keys(journal: Journal) -> dict[str, float | None]:
    """The key figures, of the idle node."""
    found = {(row["limits"], row["path"]): row for row in rows(journal) if row["node"] == IDLE}

    def figure(limits: int, path: str, column: str) -> float | None:
        value: float | None = found.get((limits, path), {}).get(column)
        return value

    ratios = {
        f"prompt_all_over_bare_{limits}": _ratio(
            figure(limits, Transition.PROMPT, "all_ms"), figure(limits, BARE, "all_ms")
        )
        for limits in SIZES[1:]
    }
    return {**ratios, "critical_ms_p50_8": figure(8, _default(), "critical_ms")}


def _default() -> str:
    """What a policy has that says nothing."""
    return str(next(field.default for field in fields(Enforcement) if field.name == "transition"))


def _ratio(one: float | None, other: float | None) -> float | None:
    return None if one is None or not other else round(one / other, 3)
