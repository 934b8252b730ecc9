"""What an expression reads and what it may cost, derived from its tree.

Cost is a power of the sample's size: `all` over a list costs n, one inside another n^2, and `map` and `filter` copy
what they have gathered so far with each step (measured: 0.3 us a step, 35 ms for a map over 1000 numbers, half a minute
for one that makes lists of lists). The library also copies each list or map of a sample that an expression names, be it
only to take one value of it (0.02 us a value). So what each may read is limited, to stay within `BUDGET` steps.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.policy import cel_patterns
from contextpolicy.policy.cel_functions import FUNCTIONS, MACROS, Macro
from contextpolicy.policy.cel_kinds import CallCost, ValueKind
from contextpolicy.policy.cel_syntax import Construct, Node
from contextpolicy.policy.context_reads import check_name, read_context

if TYPE_CHECKING:
    from collections.abc import Mapping

BUDGET = 1 << 16
"""Steps of one evaluation, about 20 ms."""
LEAST_SIZE = 8
"""An expression that can't read a sample of this many values within the budget is refused."""
COPIES = 16
"""Values that are copied in the time of a step."""
ANY_SAMPLE = BUDGET * COPIES // 10_000
"""So many accesses may copy the largest sample, of 10,000 values, within the budget."""
MAX_SUMS = 16
"""Plus signs: each copies the texts and lists on its left."""

_WALKING_OPERATORS = frozenset({"==", "!=", "in", "+"})

Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Reading:
    """`reads` are paths such as (imu, gyro): what the expression can see of each stream.

    `repeated` are the lists and maps that it names in loops, by path, and how often it does for each element.
    """

    reads: frozenset[Path]
    presence: frozenset[str]
    """The streams that it asks about, as `heard` does."""
    contexts: frozenset[str]
    """The contexts that it reads."""
    repeated: Mapping[Path, int]
    bound: Bound

    @property
    def streams(self) -> frozenset[str]:
        """The streams that it reads or asks about."""
        return self.presence | {path[0] for path in self.reads}


def read(tree: Node) -> Reading:
    """Walk a tree; ValueError when evaluating it may take too long."""
    walk = _Walk()
    cost = walk.cost(tree)
    if walk.sums > MAX_SUMS:
        raise ValueError(f"adds more often than {MAX_SUMS} times")
    return Reading(
        reads=frozenset(walk.reads),
        presence=frozenset(walk.presence),
        contexts=frozenset(walk.contexts),
        repeated=walk.repeated,
        bound=_bound(cost, walk),
    )


def size(value: object) -> int:
    """How many values a sample has, as costs count them: a long text counts as several."""
    if isinstance(value, dict):
        return len(value) + sum(map(size, value.values()))
    if isinstance(value, list):
        return 1 + sum(map(size, value))
    return 1 + len(value) // 32 if isinstance(value, str | bytes) else 1


@dataclass(frozen=True, slots=True)
class Bound:
    """How much an expression may read, by four costs: copies outside loops, patterns, loops, and copies in loops.

    Reading n values takes its `macros` at most n ** `work` steps each. `depth` is how many loops over samples are
    around a place that names one; `handed_on` is how often it selects from anything else in loops, such as an element.
    """

    work: int
    depth: int
    macros: int
    literals: int
    matches: int
    compiling_each: int
    accesses: int
    handed_on: int

    def most(self, copied: int = 0) -> int | None:
        """The most values its samples may have together; None where what it reads is bounded by a message's size alone.

        `copied` are the values of lists and maps that it names for each element.
        """
        bounds = []
        if self.accesses > ANY_SAMPLE:
            bounds.append(BUDGET * COPIES // self.accesses)
        if self.matches:
            bounds.append(BUDGET // (self.matches * cel_patterns.MATCH))
        if self.macros:
            each = self.macros * max(1, self.compiling_each)
            bounds.append(_root(BUDGET / each, max(1, self.work)) - self.literals)
        each = self.macros * copied * (1 + self.handed_on)
        if each and (self.depth or each > BUDGET * COPIES):
            bounds.append(_root(BUDGET * COPIES / each, max(1, self.depth)) - self.literals)
        return max(0, min(bounds)) if bounds else None


def _root(budget: float, power: int) -> int:
    """The largest n of which (n + 1) ** power is within the budget."""
    return int(budget ** (1 / power)) - 1


def _bound(cost: _Cost, walk: _Walk) -> Bound:
    if walk.compiling > BUDGET:
        raise ValueError("matches patterns that take too long to compile, as with many \\w")
    bound = Bound(
        work=cost.work,
        depth=walk.depth,
        macros=walk.macros,
        literals=walk.literals,
        matches=walk.matches,
        compiling_each=walk.compiling_each,
        accesses=walk.accesses,
        handed_on=walk.handed_on,
    )
    most = bound.most()
    if most is not None and most < LEAST_SIZE:
        raise ValueError("nests comprehensions, or large patterns in them, so deeply that it may take too long")
    return bound


@dataclass(frozen=True, slots=True)
class _Cost:
    """Exponents of the sample's size, for result and work; `reads`: it comes from a stream, not from an element."""

    size: int = 0
    work: int = 0
    reads: bool = False

    def __or__(self, other: _Cost) -> _Cost:
        return _Cost(max(self.size, other.size), max(self.work, other.work), self.reads or other.reads)

    def walked(self) -> _Cost:
        """After an operation that looks at all of it."""
        return _Cost(self.size, max(self.work, int(self.reads)), self.reads)

    def scalar(self) -> _Cost:
        """After an operation whose result is a number, a string or a truth value."""
        return _Cost(0, self.work, self.reads)


@dataclass
class _Walk:
    """One visit of each node."""

    macros: int = 0
    sums: int = 0
    literals: int = 0
    """Elements written in the source, beyond the first of each list."""
    matches: int = 0
    compiling: int = 0
    compiling_each: int = 0
    """Patterns, the steps that compiling them takes once, and for each element of a list."""
    accesses: int = 0
    handed_on: int = 0
    """Selections from samples, and those from anything else for each element of a list."""
    repeated: Counter[Path] = field(default_factory=Counter)
    depth: int = 0
    loops: int = 0
    times: int = 1
    """Loops over samples around the present node, and how often those over lists in the source repeat it."""
    reads: set[Path] = field(default_factory=set)
    presence: set[str] = field(default_factory=set)
    contexts: set[str] = field(default_factory=set)
    bound: list[str] = field(default_factory=list)

    def cost(self, node: Node) -> _Cost:
        context, path = read_context(node), node.path()
        if context is not None:
            self.contexts.add(context)
            return _Cost()
        return self._operation(node) if path is None else self._variable(path)

    def _operation(self, node: Node) -> _Cost:
        match node.kind:
            case Construct.CALL | Construct.METHOD:
                return self._call(node)
            case Construct.LIST | Construct.MAP:
                self.literals += max(0, len(node.parts) - 1)
                return self._all(node) | _Cost(size=1)
            case Construct.SELECT | Construct.INDEX:
                self.accesses += 1
                self.handed_on += bool(self.bound)
                return self._all(node)
            case Construct.UNARY:
                return self._all(node).scalar()
            case Construct.BINARY:
                return self._binary(node)
            case _:
                return self._all(node)

    def _all(self, node: Node) -> _Cost:
        total = _Cost()
        for part in node.parts:
            total |= self.cost(part)
        return total

    def _variable(self, path: Path) -> _Cost:
        self.accesses += len(path) - 1
        if path[0] in self.bound:
            return _Cost(size=1)
        check_name(path[0])
        self.reads.add(path)
        if self.bound:
            self.repeated.update({path[:length]: self.times for length in range(2, len(path) + 1)})
            self.depth = max(self.depth, self.loops)
        return _Cost(size=1, reads=True)

    def _binary(self, node: Node) -> _Cost:
        cost = self._all(node)
        self.sums += node.text == "+"
        if node.text in _WALKING_OPERATORS:
            cost = cost.walked()
        return cost if node.text == "+" else cost.scalar()

    def _call(self, node: Node) -> _Cost:
        if node.kind is Construct.METHOD and node.text in MACROS:
            return self._macro(node)
        function = FUNCTIONS.get(node.text)
        if function and function.cost is CallCost.ASK:
            self.presence.add(asked_stream(node))
            return _Cost()
        self.literals += max(0, len(node.parts) - 1)
        cost = self._all(node).walked()
        if function and (ValueKind.PATTERN,) in function.takes:
            self._pattern(node.parts[-1] if len(node.parts) == len(function.takes) else node)
        return cost.scalar() if function and function.cost is CallCost.WALK else cost

    def _pattern(self, pattern: Node) -> None:
        if pattern.kind is not Construct.TEXT:
            raise ValueError("matches a pattern that is not a string in quotes")
        steps = cel_patterns.steps(pattern.text)
        self.matches += 1
        self.compiling += steps
        self.compiling_each += steps if self.bound else 0

    def _macro(self, node: Node) -> _Cost:
        self.macros += 1
        if len(node.parts) < 3:
            raise ValueError(f"calls {node.text} without a name and an expression")
        over, variable, *bodies = node.parts
        check_name(variable.text)
        of = self.cost(over)
        before = self.loops, self.times
        if over.kind is Construct.LIST:
            self.times *= len(over.parts)
        else:
            self.loops += 1
        self.bound.append(variable.text)
        body = _Cost()
        for part in bodies:
            body |= self.cost(part)
        self.bound.pop()
        self.loops, self.times = before
        work = max(of.work, of.size + body.work)
        match node.text:
            case Macro.MAP:
                return _Cost(of.size + body.size, max(work, 2 * of.size + body.size), of.reads or body.reads)
            case Macro.FILTER:
                return _Cost(of.size, max(work, 2 * of.size), of.reads)
            case _:
                return _Cost(0, work, of.reads)


def asked_stream(call: Node) -> str:
    """The stream that a call asks about; ValueError when it names none."""
    if call.kind is not Construct.CALL or len(call.parts) != 1 or call.parts[0].kind is not Construct.NAME:
        raise ValueError(f"calls {call.text}() on something other than one stream, such as {call.text}(imu)")
    return call.parts[0].text
