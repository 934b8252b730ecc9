"""Random policies, and what happens to them: small numbers and a coarse clock, so that many things meet."""

from __future__ import annotations

import copy
from itertools import count
from random import Random
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import PolicyError
from tests.oracle.comparison import policy_of
from tests.oracle.story import Happening, Memory, Story, Version
from tests.oracle.units import HALF, SECOND, TICK, in_seconds

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

UNTIL = 12 * SECOND
AGES = ("<", "<=", ">", ">=")
LONGEST = 12
"""Ticks of a delay, hold or window."""


def a_story(seed: int) -> Story:
    """The same for the same seed. What chance makes may be refused, as a circle of tasks is: then once more."""
    for attempt in count():
        story = _Author(Random(f"{seed}/{attempt}")).story()  # noqa: S311 - no secret
        try:
            for version in story.versions:
                policy_of(version)
        except PolicyError:
            continue
        return story
    raise AssertionError


class _Author:
    def __init__(self, random: Random) -> None:
        self._random = random
        self._ages = self._maybe(0.3)
        """Whether expressions ask for ages: then much more can happen, and the comparison takes four times as long."""

    def story(self) -> Story:
        first = self.spec()
        versions = [Version(0, first)]
        if self._maybe(0.3):
            at = self._ticks(8, UNTIL // TICK - 8)
            versions.append(Version(at, self._edited(first)))
        names = sorted({stream["name"] for version in versions for stream in version.spec["streams"]})
        happenings = [self._happening(names, first) for _ in range(self._random.randrange(4, 30))]
        # Stable: two happenings of one instant keep their order.
        remembered = self._remembered(first) if self._maybe(0.2) else {}
        return Story(versions, sorted(happenings, key=lambda one: one.at), UNTIL, remembered=remembered)

    def spec(self) -> dict[str, Any]:
        streams = [self._stream(name) for name in "abc"[: self._random.randrange(1, 4)]]
        names = [f"ctx{number}" for number in range(self._random.randrange(4))]
        tasks = self._tasks(streams, names)
        spec: dict[str, Any] = {
            "streams": streams,
            "tasks": tasks,
            "contexts": self._contexts(names, streams, tasks),
        }
        if names and self._maybe(0.3):
            spec["fallback"] = self._random.choice(names)
        if names and self._maybe(0.1):
            spec["force"] = {"context": self._random.choice(names), "until": self._ticks(1, 40)}
        for stream in streams:
            if names and self._maybe(0.3) and ("staleAfter" in stream or "liveliness" in stream):
                stream["fallback"] = self._random.choice(names)
        return spec

    def _remembered(self, spec: dict[str, Any]) -> dict[str, Memory]:
        """What the tasks had before a restart; in half of these stories all were at rest or suspended."""
        weights = [0.0] if self._maybe(0.5) else [0.0, 0.5, 1.0, 3.0, 8.0]
        known = {}
        for task in spec["tasks"]:
            weight = self._random.choice(weights)
            if self._maybe(0.9):
                known[task["name"]] = Memory(weight, suspended=not weight and self._maybe(0.6))
        return known

    # Streams.

    def _stream(self, name: str) -> dict[str, Any]:
        stream: dict[str, Any] = {"name": name, "key": f"robot/{name}"}
        if self._maybe(0.5):
            stream["staleAfter"] = self._duration(4)
        if self._maybe(0.1):
            stream["liveliness"] = f"alive/{name}"
        if self._maybe(0.1):
            stream["filter"] = f"{name}.x >= 1"
        if self._maybe(0.15) and "staleAfter" not in stream:
            stream[self._random.choice(["debounce", "sampleEvery"])] = self._duration(1, 6)
        if self._maybe(0.6):
            stream["features"] = [self._feature(name, op) for op in self._some(["count", "rate", "mean", "min", "max"])]
        return stream

    def _feature(self, stream: str, op: str) -> dict[str, str]:
        of = {"of": f"{stream}.x"} if op in {"mean", "min", "max"} else {}
        return {"name": f"{op}x", "op": op, "over": self._duration(), **of}

    def _happening(self, streams: Sequence[str], spec: dict[str, Any]) -> Happening:
        name = self._random.choice(streams)
        watched = [stream["name"] for stream in spec["streams"] if "liveliness" in stream]
        gone = name in watched and self._maybe(0.15)
        fields = None if gone else {"x": self._random.randrange(4), "p": self._maybe(0.6)}
        return Happening(self._ticks(1, UNTIL // TICK), name, fields)

    # Expressions.

    def _condition(self, streams: Sequence[dict[str, Any]], contexts: Sequence[str], depth: int = 2) -> str:
        if depth and self._maybe(0.45):
            parts = [self._condition(streams, contexts, depth - 1) for _ in range(2)]
            joined = self._random.choice([" && ", " || "]).join(f"({part})" for part in parts)
            return joined if self._maybe(0.8) else f"!({joined})"
        if contexts and self._maybe(0.3):
            return self._random.choice(["", "!"]) + f"contexts.{self._random.choice(contexts)}"
        return self._atom(self._random.choice(streams))

    def _atom(self, stream: dict[str, Any]) -> str:
        name, compare = stream["name"], self._random.choice(["<", "<=", ">", ">=", "=="])
        kinds: list[Callable[[], str]] = [
            lambda: f"{name}.p",
            lambda: f"{name}.x {compare} {self._random.randrange(4)}",
            lambda: self._random.choice(["", "!"]) + f"heard({name})",
            *[lambda: f"age({name}) {self._random.choice(AGES)} {in_seconds(self._ticks(1, 12) + HALF)}"] * self._ages,
            lambda: f"has({name}.x)",
        ]
        for feature in stream.get("features", ()):
            kinds += [lambda f=feature["name"]: f"{name}.{f} {compare} {self._random.randrange(1, 3)}"] * 2  # type: ignore[misc]
        return self._random.choice(kinds)()

    def _number(self, stream: dict[str, Any]) -> str:
        name = stream["name"]
        fields = [f"{name}.x", *(f"{name}.{feature['name']}" for feature in stream.get("features", ()))]
        field = self._random.choice(fields)
        return self._random.choice([field, f"min({field}, 2.0)", f"{field} * 0.5", f"{field} + 1.0", f"abs({field})"])

    # Tasks.

    def _tasks(self, streams: Sequence[dict[str, Any]], contexts: Sequence[str]) -> list[dict[str, Any]]:
        leaves = [self._leaf(f"t{number}", streams, contexts) for number in range(self._random.randrange(2, 6))]
        free = [leaf["name"] for leaf in leaves]
        groups: list[dict[str, Any]] = []
        while len(free) > 1 and self._maybe(0.4) and len(groups) < 2:
            chosen = self._random.sample(free, self._random.randrange(1, len(free)))
            group = {"name": f"g{len(groups)}", "subtasks": chosen, "satisfiedBy": self._random.choice(["All", "Any"])}
            groups.append({**group, **self._interest(streams, contexts)})
            free = [name for name in free if name not in chosen] + [f"g{len(groups) - 1}"]
        for number, leaf in enumerate(leaves):
            if number and self._maybe(0.15):
                required = self._random.choice(leaves[:number])["name"]
                leaf.setdefault("requires", []).append({"task": required})
        return [*leaves, *groups]

    def _leaf(self, name: str, streams: Sequence[dict[str, Any]], contexts: Sequence[str]) -> dict[str, Any]:
        leaf = {"name": name, "selector": {"matchLabels": {"app": name}}, **self._interest(streams, contexts)}
        if self._maybe(0.3):
            leaf["min"] = f"{self._random.randrange(1, 30) * 10}m"
        if self._maybe(0.3):
            leaf["max"] = f"{self._random.randrange(30, 200) * 10}m"
        if self._maybe(0.15):
            leaf["suspendedCpu"] = f"{self._random.randrange(1, 10) * 10}m"
        if self._maybe(0.15):
            leaf["protected"] = True
        return leaf

    def _interest(self, streams: Sequence[dict[str, Any]], contexts: Sequence[str]) -> dict[str, Any]:
        """What makes a task matter."""
        own: dict[str, Any] = {}
        if self._maybe(0.5):
            own["priority"] = self._random.choice([0, 1, 2, 3, 5, 10])
        if self._maybe(0.3):
            own["idle"] = self._random.choice([0, 0.25, 0.5, 1])
        if self._maybe(0.6):
            own["activity"] = [self._activity(streams, contexts) for _ in range(self._random.randrange(1, 3))]
        if self._maybe(0.25):
            held = {"hold": self._duration()} if self._maybe(0.5) else {}
            own["requires"] = [{"when": self._condition(streams, contexts), **held}]
        return own

    def _activity(self, streams: Sequence[dict[str, Any]], contexts: Sequence[str]) -> dict[str, Any]:
        own: dict[str, Any] = {}
        if self._maybe(0.5):
            own["stream"] = self._random.choice(streams)["name"]
        if self._maybe(0.8):
            own["when"] = self._condition(streams, contexts)
        if self._maybe(0.25):
            own["until"] = self._condition(streams, contexts)
        if self._maybe(0.4):
            own["score"] = self._random.choice([0.5, 1, 2, 4])
        elif self._maybe(0.3):
            own["scoreFrom"] = self._number(self._random.choice(streams))
        if self._maybe(0.5):
            own["hold"] = self._duration()
        if self._maybe(0.3):
            own["decay"] = self._random.choice(["2500ms", "5s"])  # ten steps of a tick or two
        return own

    # Contexts.

    def _contexts(
        self, names: Sequence[str], streams: Sequence[dict[str, Any]], tasks: Sequence[dict[str, Any]]
    ) -> list[dict[str, Any]]:
        order = self._random.sample(list(names), len(names))  # each may read those before it
        made = {}
        for place, name in enumerate(order):
            made[name] = self._context(name, streams, order[:place])
            made[name]["tasks"] = {task["name"]: self._effect(task) for task in tasks if self._maybe(0.5)}
        return [made[name] for name in names]

    def _context(self, name: str, streams: Sequence[dict[str, Any]], others: Sequence[str]) -> dict[str, Any]:
        context: dict[str, Any] = {"name": name}
        if self._maybe(0.9):
            context["when"] = self._condition(streams, others)
            if self._maybe(0.25):
                context["until"] = self._condition(streams, others)
        for delay in ("enterAfter", "exitAfter"):
            if self._maybe(0.35):
                context[delay] = self._duration(1, 8)
        return context

    def _effect(self, task: dict[str, Any]) -> dict[str, Any]:
        effect: dict[str, Any] = self._random.choice(
            [
                {"weight": self._random.choice([0, 0.5, 1, 3, 8])},
                {"scale": self._random.choice([0, 0.5, 2, 3])},
                {"suspend": True},
                {"suspend": False},
                {"suspend": False, "weight": self._random.choice([1, 4])},
                {"suspend": False, "scale": self._random.choice([0.5, 2])},
                {},
            ]
        )
        suspends = effect.get("suspend") or effect.get("weight") == 0 or effect.get("scale") == 0
        if "subtasks" in task or suspends or (effect and self._maybe(0.7)):
            return dict(effect) or {"suspend": True}
        bounds = sorted(self._random.sample(range(30, 80), 2))
        least, most = _limit(task, bounds[0] * 10), _limit(task, bounds[1] * 10)
        chosen = self._some(["min", "max"])
        return {**effect, **{name: f"{least if name == 'min' else most}m" for name in chosen}}

    # Edits.

    def _edited(self, spec: dict[str, Any]) -> dict[str, Any]:
        new: dict[str, Any] = copy.deepcopy(spec)
        for _ in range(self._random.randrange(1, 3)):
            self._random.choice([self._edit_stream, self._edit_task, self._edit_context])(new)
        return new

    def _edit_stream(self, spec: dict[str, Any]) -> None:
        stream = self._random.choice(spec["streams"])
        if "debounce" not in stream:
            stream["staleAfter"] = self._duration(4)

    def _edit_task(self, spec: dict[str, Any]) -> None:
        task = self._random.choice(spec["tasks"])
        if self._maybe(0.2):
            task.pop("activity", None)
        else:
            task["priority"] = self._random.randrange(1, 6)
        for activity in task.get("activity", ()):
            if self._maybe(0.3):
                activity["hold"] = self._duration()

    def _edit_context(self, spec: dict[str, Any]) -> None:
        for context in spec["contexts"]:
            if self._maybe(0.5):
                context[self._random.choice(["enterAfter", "exitAfter"])] = self._duration(1, 8)
            elif self._maybe(0.3) and "when" in context:
                context["when"] = self._condition(spec["streams"], ())

    # Choices.

    def _maybe(self, chance: float) -> bool:
        return self._random.random() < chance

    def _some(self, of: Sequence[str]) -> list[str]:
        return self._random.sample(list(of), self._random.randrange(1, len(of) + 1))

    def _ticks(self, least: int, most: int) -> int:
        return self._random.randrange(least, most) * TICK

    def _duration(self, least: int = 1, most: int = LONGEST) -> str:
        return f"{round(in_seconds(self._ticks(least, most)) * 1000)}ms"


def _limit(task: dict[str, Any], bound: int) -> int:
    """Within the task's own bounds, which a context can only narrow."""
    return min(bound, int(task["max"][:-1])) if "max" in task else bound
