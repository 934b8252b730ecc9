"""Expected plans as a file, so that a repository of policies can test them in its own CI.

A list of expectations, or an object with the list under `expect`. Each says when (`at: 12.0`, or `from: 13, to: 20` for
throughout) and what:

  contexts: [moving]                      exactly these contexts, in any order
  suspended: [speech]                     exactly these tasks
  shares: {speech: 10m, slam: {min: 1500m, max: "2"}}
  weights: {slam: 10, speech: {max: 1}}
  feasible: true                          the plan meets every need and floor
  plans: {max: 5}                         number of plans that began in the interval (only with from and to)
  misses: {slam: {max: 0.01}}             part of its inputs that is late or dropped (likewise; predicted)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import Fault, Finding, FindingsError
from contextpolicy.policy.quantities import CPU_ALLOWED, parse_cpu
from contextpolicy.policy.suggestions import did_you_mean
from contextpolicy.policy.validation.documents import DocumentError, read

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.validation.documents import Document

CHECKS = ("contexts", "suspended", "shares", "weights", "feasible", "plans", "misses")
FIELDS = ("at", "from", "to", *CHECKS)


class ExpectationError(FindingsError):
    """An invalid file of expectations."""


@dataclass(frozen=True, slots=True)
class Range:
    """The values that a number may have, both ends included."""

    low: float
    high: float

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Expectation:
    """What must hold from `start` to `end` (s), both included; None means not checked."""

    line: int
    start: float
    end: float
    contexts: frozenset[str] | None = None
    suspended: frozenset[str] | None = None
    feasible: bool | None = None
    shares: Mapping[str, Range] | None = None
    weights: Mapping[str, Range] | None = None
    plans: Range | None = None
    misses: Mapping[str, Range] | None = None


def parse(text: str, policy: Policy, *, subject: str) -> list[Expectation]:
    """Read a file; ExpectationError carries everything that is wrong with it."""
    try:
        documents = list(read(text))
    except DocumentError as error:
        finding = Finding(f"line {error.position.line}", None, str(error), Fault.FILE)
        raise ExpectationError(subject, (finding,)) from error
    findings = list(_surplus(documents))
    body = documents[0].body if documents else None
    path = "expect" if isinstance(body, dict) else ""
    items = body.get("expect") if isinstance(body, dict) else body
    if not isinstance(items, list) or not items:
        raise ExpectationError(subject, (*findings, Finding(path or "file", items, "a list of expectations")))
    reader = _Reader(policy, findings)
    expectations = [
        reader.expectation(f"{path}[{index}]", item, documents[0].position(f"{path}[{index}]").line)
        for index, item in enumerate(items)
    ]
    if findings:
        raise ExpectationError(subject, tuple(findings))
    return expectations


def _surplus(documents: Sequence[Document]) -> Iterator[Finding]:
    """Whatever would be ignored: an expectation that is never checked looks like one that holds."""
    for document in documents[1:]:
        yield Finding(f"line {document.position('').line}", "---", "one document only: append to the list instead")
    for document in documents[:1]:
        for path in document.duplicates:
            yield Finding(path, path.rpartition(".")[2], "each key once in an object")
        if isinstance(document.body, dict):
            for name in document.body.keys() - {"expect"}:
                yield Finding(name, document.body[name], "no field besides expect")


class _Reader:
    """One file's entries; findings are collected, to report all at once."""

    def __init__(self, policy: Policy, findings: list[Finding]) -> None:
        self._findings = findings
        self._tasks = [task.name for task in policy.tasks]
        self._leaves = [task.name for task in policy.leaves]
        self._contexts = [context.name for context in policy.contexts]

    def expectation(self, path: str, raw: Any, line: int) -> Expectation:
        if not isinstance(raw, dict):
            self._refuse(path, raw, "an object")
            return Expectation(line, 0.0, 0.0)
        for name in raw.keys() - set(FIELDS):
            self._refuse(f"{path}.{name}", raw[name], "one of " + ", ".join(FIELDS) + did_you_mean(name, FIELDS))
        self._check_asks(path, raw)
        start, end = self._interval(path, raw)
        return Expectation(
            line=line,
            start=start,
            end=end,
            contexts=self._names(f"{path}.contexts", raw.get("contexts"), self._contexts),
            suspended=self._names(f"{path}.suspended", raw.get("suspended"), self._tasks),
            feasible=self._flag(f"{path}.feasible", raw.get("feasible")),
            shares=self._ranges(f"{path}.shares", raw.get("shares"), self._leaves, parse_cpu, CPU_ALLOWED),
            weights=self._ranges(f"{path}.weights", raw.get("weights"), self._tasks, _number, "a number"),
            plans=self._range(f"{path}.plans", raw["plans"], _number, "a number")
            if raw.get("plans") is not None
            else None,
            misses=self._ranges(f"{path}.misses", raw.get("misses"), self._leaves, _number, "a fraction from 0 to 1"),
        )

    def _check_asks(self, path: str, raw: dict[str, Any]) -> None:
        """It must check something, and none of its checks may be null."""
        asked = [name for name in CHECKS if name in raw]
        if not asked:
            self._refuse(path, raw, "at least one of " + ", ".join(CHECKS))
        for name in asked:
            if raw[name] is None:
                self._refuse(f"{path}.{name}", None, "a value; or leave out the field")
        for name in ("plans", "misses"):
            if name in raw and "at" in raw:
                self._refuse(f"{path}.{name}", raw[name], f"{name} only with from and to")

    def _interval(self, path: str, raw: dict[str, Any]) -> tuple[float, float]:
        given = {name: raw[name] for name in ("at", "from", "to") if name in raw}
        if set(given) not in ({"at"}, {"from", "to"}) or not all(_is_time(time) for time in given.values()):
            self._refuse(path, given, "at, or from and to, in seconds")
            return 0.0, 0.0
        start, end = (given["at"], given["at"]) if "at" in given else (given["from"], given["to"])
        if start > end:
            self._refuse(f"{path}.to", end, f"at least {start:g}, the value of from")
        return float(start), float(end)

    def _names(self, path: str, raw: Any, known: Sequence[str]) -> frozenset[str] | None:
        if raw is None:
            return None
        if not isinstance(raw, list):
            self._refuse(path, raw, "a list of names")
            return None
        for name in raw:
            if name not in known:
                self._refuse(path, name, "one of " + ", ".join(known) + did_you_mean(name, known))
        return frozenset(map(str, raw))

    def _flag(self, path: str, raw: Any) -> bool | None:
        if raw is not None and not isinstance(raw, bool):
            self._refuse(path, raw, "true or false")
        return raw if isinstance(raw, bool) else None

    def _ranges(
        self, path: str, raw: Any, tasks: Sequence[str], number: Callable[[object], float], allowed: str
    ) -> dict[str, Range] | None:
        if raw is None:
            return None
        if not isinstance(raw, dict) or not raw:
            self._refuse(path, raw, "a map of tasks")
            return None
        self._names(path, list(raw), tasks)
        return {str(task): self._range(f"{path}.{task}", value, number, allowed) for task, value in raw.items()}

    def _range(self, path: str, raw: Any, number: Callable[[object], float], allowed: str) -> Range:
        """An exact number, or min and max."""
        bounds = raw if isinstance(raw, dict) else {"min": raw, "max": raw}
        if not bounds or bounds.keys() - {"min", "max"}:
            self._refuse(path, raw, f"{allowed}, or min and max")
            return Range(0, 0)
        try:
            found = Range(number(bounds.get("min", 0)), number(bounds["max"]) if "max" in bounds else math.inf)
        except ValueError:
            self._refuse(path, raw, allowed)
            return Range(0, 0)
        if found.low > found.high:
            self._refuse(path, raw, "a min of at most max")
        return found

    def _refuse(self, path: str, value: object, allowed: str) -> None:
        self._findings.append(Finding(path, value, allowed))


def _is_time(raw: object) -> bool:
    return isinstance(raw, int | float) and not isinstance(raw, bool) and 0 <= raw < math.inf


def _number(raw: object) -> float:
    if _is_time(raw):
        return float(str(raw))
    raise ValueError(f"{raw!r} is not a number")
