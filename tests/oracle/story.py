"""What happens to a policy, and the moments at which one can look at it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.oracle.units import HALF, TICK

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


class Happening(NamedTuple):
    """A sample, or with `fields` None the end of the stream's liveliness token."""

    at: int
    stream: str
    fields: Mapping[str, Any] | None


class Version(NamedTuple):
    """The policy's spec from this instant on; an edit comes after all else of its instant."""

    at: int
    spec: Mapping[str, Any]


class Memory(NamedTuple):
    """What a task had before the operator was restarted."""

    weight: float
    suspended: bool


@dataclass(frozen=True)
class Story:
    """All of it, in order."""

    versions: Sequence[Version]
    happenings: Sequence[Happening]
    until: int
    cores: int = 4
    remembered: Mapping[str, Memory] = field(default_factory=dict)
    """By task; empty where the operator was not restarted."""

    @property
    def has_ages(self) -> bool:
        """Whether anything can change between the ticks."""
        return "age(" in repr([version.spec for version in self.versions])

    def instants(self) -> range:
        """All at which something may happen, but for what comes just after them."""
        return range(0, self.until + 1, HALF if self.has_ages else TICK)


@dataclass(frozen=True)
class Moment:
    """`seen` happenings have come; `timed` says whether what is due has acted, after the first one of its instant."""

    at: int
    seen: int
    timed: bool
    version: int = 0

    def is_due(self, at: int) -> bool:
        return at < self.at or (at == self.at and self.timed)


def moments(story: Story) -> Iterator[Moment]:
    """All at which anything can change, in order."""
    seen, has_ages = 0, story.has_ages
    for at in story.instants():
        version = max(n for n, one in enumerate(story.versions) if one.at < at or n == 0)
        first = seen
        while seen < len(story.happenings) and story.happenings[seen].at == at:
            seen += 1
            if seen == first + 1:
                yield Moment(at, seen, timed=False, version=version)
            yield Moment(at, seen, timed=True, version=version)
        if seen == first:
            yield Moment(at, seen, timed=True, version=version)
        if any(one.at == at for one in story.versions[1:]):
            version += 1
            yield Moment(at, seen, timed=True, version=version)
        if has_ages:
            yield Moment(at + 1, seen, timed=True, version=version)
