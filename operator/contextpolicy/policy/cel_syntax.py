"""What a CEL source reads and what it may cost, told from its text: the CEL library shows no syntax tree.

Cost is a power of the sample's size: `all` over a list costs n, one inside another n^2, and `map` and `filter` copy
what they have gathered so far with each step (measured: 0.3 us a step, 35 ms for a map over 1000 numbers, half a minute
for one that makes lists of lists). So each expression has a most that it may read, to stay within `BUDGET` steps.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

BUDGET = 1 << 16
"""Steps of one evaluation, about 20 ms."""
LEAST_SIZE = 8
"""An expression that can't read a sample of this many values within the budget is refused."""
MAX_BRACKETS = 32
MAX_SUMS = 16
"""Plus signs: each copies the texts and lists on its left."""
MAX_PATTERN = 64
"""Characters of a regular expression, which is compiled anew at each evaluation."""

MACROS = frozenset({"all", "exists", "exists_one", "existsOne", "map", "filter"})
_CONSTANTS = frozenset({"true", "false", "null"})
_SCALAR_FUNCTIONS = frozenset({"norm", "abs", "sqrt", "size", "int", "uint", "double", "has", "contains", "matches"})
_SCALAR_OPERATORS = frozenset({"-", "*", "/", "%", "<", ">", "<=", ">=", "==", "!=", "&&", "||", "!", "in"})
_WALKING_OPERATORS = frozenset({"==", "!=", "in", "+"})
_CLOSES = {"(": ")", "[": "]", "{": "}"}

_TOKEN = re.compile(
    r"""\s+|//[^\n]*
    |(?P<text>(?:[rR][bB]?|[bB][rR])(?:\"{3}(?s:.*?)\"{3}|'{3}(?s:.*?)'{3}|"[^"\n]*"|'[^'\n]*')
      |[bB]?(?:\"{3}(?s:.*?)\"{3}|'{3}(?s:.*?)'{3}|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'))
    |(?P<name>[A-Za-z_]\w*)
    |(?P<number>\d[\w.]*)
    |(?P<operator>==|!=|<=|>=|&&|\|\||.)""",
    re.VERBOSE,
)

Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Syntax:
    """`reads` are paths such as (imu, gyro): what the expression can see of each stream."""

    reads: frozenset[Path]
    max_size: int | None
    """The most values its samples may have together; None where it costs the same whatever it reads."""

    @property
    def streams(self) -> frozenset[str]:
        """The variables."""
        return frozenset(path[0] for path in self.reads)


def scan(source: str) -> Syntax:
    """Read a source that compiles; ValueError when it may run away."""
    tokens = [match[0] for match in _TOKEN.finditer(source) if match.lastgroup]
    brackets = 0
    for token in tokens:
        brackets += (token in _CLOSES) - (token in _CLOSES.values())
        if brackets > MAX_BRACKETS:
            raise ValueError(f"nests brackets deeper than {MAX_BRACKETS}")
    if tokens.count("+") > MAX_SUMS:
        raise ValueError(f"adds more than {MAX_SUMS} times")
    scanner = _Scanner(tokens)
    cost = scanner.sequence()
    return Syntax(frozenset(scanner.reads), _max_size(cost, scanner.macros, 1 + tokens.count(",") - scanner.macros))


def size(value: object) -> int:
    """How many values a sample has, as costs count them: a long text counts as several."""
    if isinstance(value, dict):
        return len(value) + sum(map(size, value.values()))
    if isinstance(value, list):
        return 1 + sum(map(size, value))
    return 1 + len(value) // 32 if isinstance(value, str | bytes) else 1


def _max_size(cost: _Cost, macros: int, literals: int) -> int | None:
    if not macros:
        return None
    most = int((BUDGET / macros) ** (1 / max(1, cost.work))) - literals
    if most < LEAST_SIZE:
        raise ValueError("nests comprehensions so deeply that it may run away")
    return most


@dataclass(frozen=True, slots=True)
class _Cost:
    """Powers of the sample's size: of the result and of the work; `reads` says that it is a stream's, no element."""

    size: int = 0
    work: int = 0
    reads: bool = False

    def __or__(self, other: _Cost) -> _Cost:
        return _Cost(max(self.size, other.size), max(self.work, other.work), self.reads or other.reads)

    def walked(self) -> _Cost:
        """After an operation that looks at all of it."""
        return _Cost(self.size, max(self.work, int(self.reads)), self.reads)


@dataclass
class _Scanner:
    """Recursive descent over the tokens, as far as costs need it."""

    tokens: list[str]
    at: int = 0
    macros: int = 0
    reads: set[Path] = field(default_factory=set)
    bound: list[str] = field(default_factory=list)

    def sequence(self) -> _Cost:
        """Operands and operators up to the closing bracket, which is left standing."""
        cost, operators = _Cost(), set[str]()
        while self.at < len(self.tokens) and self.tokens[self.at] not in _CLOSES.values():
            token = self.tokens[self.at]
            if _is_operand(token):
                cost |= self._operand()
            else:
                operators.add(token)
                self.at += 1
        if operators & _WALKING_OPERATORS:
            cost = cost.walked()
        if operators & _SCALAR_OPERATORS and not operators & {"?", ","}:
            cost = _Cost(0, cost.work, cost.reads)
        return cost

    def _operand(self) -> _Cost:
        token = self._take()
        grouped = token == "("  # noqa: S105 - a bracket
        if token in _CLOSES:
            cost = self._closed(self.sequence())
            if not grouped:
                cost |= _Cost(size=1)
        elif not _is_name(token) or token in _CONSTANTS:
            cost = _Cost()
        elif self._next() == "(":
            cost = self._call(token, _Cost())
        elif token in self.bound:
            cost = _Cost(size=1)
        else:
            cost = self._variable(token)
        return self._tail(cost)

    def _variable(self, name: str) -> _Cost:
        path = [name]
        while self._next() == "." and _is_name(self._next(1)) and self._next(2) != "(":
            path.append(self.tokens[self.at + 1])
            self.at += 2
        self.reads.add(tuple(path))
        return _Cost(size=1, reads=True)

    def _tail(self, cost: _Cost) -> _Cost:
        """The selections, calls and indices that follow an operand."""
        while self._next() in {".", "["}:
            if self._take() == "[":
                cost |= self._closed(self.sequence())
                continue
            name = self._take()
            if self._next() == "(":
                cost = self._macro(name, cost) if name in MACROS else self._call(name, cost)
        return cost

    def _call(self, name: str, receiver: _Cost) -> _Cost:
        opening = self.at
        self._take()
        cost = self._closed(receiver | self.sequence()).walked()
        if name == "matches":
            _check_pattern(self.tokens[opening : self.at])
        return _Cost(0 if name in _SCALAR_FUNCTIONS else cost.size, cost.work, cost.reads)

    def _macro(self, name: str, over: _Cost) -> _Cost:
        self.macros += 1
        self._take()
        self.bound.append(self._take())
        self._take()
        body = self._closed(self.sequence())
        self.bound.pop()
        work = max(over.work, over.size + body.work)
        match name:
            case "map":
                return _Cost(over.size + body.size, max(work, 2 * over.size + body.size), over.reads or body.reads)
            case "filter":
                return _Cost(over.size, max(work, 2 * over.size), over.reads)
            case _:
                return _Cost(0, work, over.reads)

    def _closed(self, cost: _Cost) -> _Cost:
        self._take()
        return cost

    def _next(self, ahead: int = 0) -> str:
        return self.tokens[self.at + ahead] if self.at + ahead < len(self.tokens) else ""

    def _take(self) -> str:
        token = self._next()
        self.at += 1
        return token


def _is_name(token: str) -> bool:
    return token.isidentifier()


def _is_operand(token: str) -> bool:
    return token in _CLOSES or (token not in _SCALAR_OPERATORS and (token[0].isalnum() or token[0] in "_'\""))


def _check_pattern(call: list[str]) -> None:
    pattern = call[-2] if len(call) >= 3 else ""
    if not pattern.endswith(("'", '"')) or call[-3] not in {"(", ","}:
        raise ValueError("matches a pattern that is no text in quotes")
    if len(pattern) > MAX_PATTERN or "{" in pattern:
        raise ValueError(f"matches a pattern of more than {MAX_PATTERN} characters or with counted repetitions")
