"""In which order conditions are evaluated: what reads contexts comes after them, and sees each instant as a whole.

Two contexts may turn at one instant. A condition over both must not see the first one turned and the second one not
yet: that would count transitions, start delays and raise activities that no instant asks for. So it is with all that
time brings: a window may slide, a stream fall silent and a delay end at one instant. What expressions see changes
first, then each of them is evaluated once, and a delay whose condition ends with it is not over.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, TypeAlias

from contextpolicy.planning.conditions.context import ContextState
from contextpolicy.planning.conditions.initiative import Initiative
from contextpolicy.policy.context_reads import Dependencies, rank_after

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from contextpolicy.planning.conditions import expressions

Reader: TypeAlias = Initiative | ContextState


class Evaluation:
    """All readers of streams and contexts; those that read contexts wait until the others have seen the instant."""

    def __init__(self, initiatives: Iterable[Initiative], contexts: Sequence[ContextState]) -> None:
        ranks = Dependencies({context.spec.name: context.reads for context in contexts}).ranks()
        everything: list[Reader] = [*initiatives, *contexts]
        self._ranks: dict[expressions.Reader, int] = {reader: rank_after(reader.reads, ranks) for reader in everything}
        self.readers = sorted(everything, key=lambda reader: self._ranks[reader])
        """Each after all contexts that it reads."""
        self.of_stream: dict[str, list[Reader | _Later]] = defaultdict(list)
        """Whom to ask at once when a stream has a new value."""
        self._reading: dict[str, list[Reader]] = defaultdict(list)
        self._of_context: dict[str, list[Reader]] = defaultdict(list)
        self.waiting: dict[expressions.Reader, bool] = {}
        """Those that `follow` is to ask, each with whether a sample of a stream that it reads came."""
        for reader in self.readers:
            self._enter(reader)

    def wait(self, stream: str, *, sampled: bool = False) -> None:
        """Let all who read the stream wait: it has a new value, or none, at an instant that is not over."""
        for reader in self._reading[stream]:
            self.waiting[reader] = sampled or self.waiting.get(reader, False)

    def elapse(self, reader: expressions.Reader) -> None:
        """Let a reader wait: a time that it waited for is over."""
        self.waiting.setdefault(reader, False)

    def on_context(self, context: str) -> None:
        """The context began or ceased to be active."""
        for reader in self._of_context[context]:
            self.waiting.setdefault(reader, False)

    def follow(self, now: float) -> None:
        """Ask those that wait, the first in rank first: what it changes may let others wait."""
        while self.waiting:
            reader = min(self.waiting, key=self._ranks.__getitem__)
            reader.on_value(now, sampled=self.waiting.pop(reader))

    def _enter(self, reader: Reader) -> None:
        for stream in reader.streams:
            self.of_stream[stream.spec.name].append(_Later(reader, self.waiting) if reader.reads else reader)
            self._reading[stream.spec.name].append(reader)
        for context in reader.reads:
            self._of_context[context].append(reader)


class _Later:
    """Lets a reader of contexts wait."""

    def __init__(self, reader: Reader, waiting: dict[expressions.Reader, bool]) -> None:
        self._reader, self._waiting = reader, waiting

    def on_value(self, now: float, *, sampled: bool = False) -> None:  # noqa: ARG002 - as a reader's
        self._waiting[self._reader] = sampled or self._waiting.get(self._reader, False)
