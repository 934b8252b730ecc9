"""Keeps the newest samples and plans of each policy, as the bytes that went over the bus.

Bytes, because their size is known: decoded, a laser scan takes ten times as much. Taking one costs the hot path an
append; decoding is left to the reader of the recording.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

SECONDS = 300.0
"""How far back a recording reaches, if it fits."""
BUDGET = 32 << 20
"""Bytes for all policies together, an equal part for each; the chart's memory limit has room for it."""
OVERHEAD = 200
"""Bytes that a record costs besides its payload, attachment and key: objects, references, the place in the queue."""
BEFORE_PART = 4
"""What is older than all other samples has at most one part in this many of their bytes: of large payloads the rest is
worth more."""
PLANS_PART = 4
"""Plans have one part in this many of a policy's bytes: a storm of samples must not push out what was decided."""


class SampleRecord(NamedTuple):
    """One payload as it came; `arrived` is monotonic seconds, `key` is empty where the stream's own names it."""

    arrived: float
    stream: str
    payload: bytes
    attachment: bytes
    key: str


RawSample: TypeAlias = tuple[float, str, bytes, bytes, str]
"""A SampleRecord without names."""


class PlanRecord(NamedTuple):
    """One message of the decision bus, when it was published (monotonic seconds), and until when it was in force.

    None: until the next one, or still.
    """

    published: float
    payload: bytes
    until: float | None = None


@dataclass(slots=True)
class Records:
    """The records of one policy."""

    samples: deque[RawSample] = field(default_factory=deque)
    plans: deque[PlanRecord] = field(default_factory=deque)
    before: dict[str, RawSample] = field(default_factory=dict)
    """The last sample of each stream that is older than `samples`, oldest first: a replay would begin blind."""
    streams: Collection[str] = ()
    """Those that the policy reads."""
    sample_bytes: int = 0
    before_bytes: int = 0
    plan_bytes: int = 0
    limit: int = 0
    """Bytes that the samples may take, those before them included."""

    def keep_before(self, record: RawSample) -> None:
        """Keep it as the last one of its stream, and let go of the oldest if they take too much."""
        if record[1] in self.before:
            self.drop_before(record[1])
        self.before[record[1]] = record
        self.before_bytes += _size(record)
        while self.before_bytes > self.limit // BEFORE_PART:
            self.drop_before(next(iter(self.before)))

    def drop_before(self, stream: str) -> None:
        """Let go of the stream's sample that is older than the others."""
        self.before_bytes -= _size(self.before.pop(stream))

    def copy(self) -> Records:
        """What is there now, for another thread."""
        return Records(self.samples.copy(), self.plans.copy(), dict(self.before))


class FlightRecorder:
    """Everything on the loop's thread. `budget` is in bytes, `seconds` how far back records reach."""

    def __init__(self, budget: int, seconds: float) -> None:
        self._budget, self._seconds = budget, seconds
        self._policies: dict[str, Records] = {}

    def begin(self, policy: str, streams: Collection[str]) -> Records:
        """Record this policy, which reads these streams, from now on, or go on with it after an edit."""
        records = self._policies.setdefault(policy, Records())
        records.streams = frozenset(streams)
        for gone in records.before.keys() - records.streams:
            records.drop_before(gone)
        self._share_out()
        return records

    def forget(self, policy: str) -> None:
        """The policy is gone, and with it its records."""
        self._policies.pop(policy, None)
        self._share_out()

    def take_sample(self, records: Records, record: RawSample) -> None:
        """Keep a sample, and let go of those that are too old or too many; one beyond all bounds is not kept.

        On the hot path: so a plain tuple, read by position, and a limit that is known beforehand.
        """
        size, samples = _size(record), records.samples
        if size > records.limit:
            return
        samples.append(record)
        records.sample_bytes += size
        if records.sample_bytes + records.before_bytes > records.limit or record[0] - samples[0][0] > self._seconds:
            self._let_go(records, record[0])

    def _let_go(self, records: Records, now: float) -> None:
        samples, before = records.samples, records.before
        while samples and (
            records.sample_bytes + records.before_bytes > records.limit or now - samples[0][0] > self._seconds
        ):
            if len(samples) == 1 and before:  # the newest one is worth more
                records.drop_before(next(iter(before)))
                continue
            oldest = samples.popleft()
            records.sample_bytes -= _size(oldest)
            if oldest[1] in records.streams:
                records.keep_before(oldest)

    def take_plan(self, policy: str, record: PlanRecord) -> None:
        """Keep a plan of a policy that is recorded, likewise; the newest is always kept."""
        records = self._policies[policy]
        records.plans.append(record)
        records.plan_bytes += len(record.payload) + OVERHEAD
        limit = records.limit // (PLANS_PART - 1)
        while len(records.plans) > 1 and (
            records.plan_bytes > limit or record.published - records.plans[0].published > self._seconds
        ):
            records.plan_bytes -= len(records.plans.popleft().payload) + OVERHEAD

    def end_plan(self, policy: str, moment: float) -> None:
        """No plan is in force from now on (a pause), until the next one."""
        records = self._policies.get(policy)
        if records is not None and records.plans and records.plans[-1].until is None:
            records.plans[-1] = records.plans[-1]._replace(until=moment)

    def plans_since(self, policy: str, moment: float) -> Iterator[PlanRecord]:
        """The plans published or ended after `moment`, oldest first."""
        records = self._policies.get(policy)
        if records is not None:
            yield from (plan for plan in list(records.plans) if max(plan.published, plan.until or 0.0) > moment)

    def of(self, policy: str) -> Records | None:
        """What is recorded of the policy; None when the policy does not exist."""
        return self._policies.get(policy)

    def _share_out(self) -> None:
        for records in self._policies.values():
            records.limit = self._budget // len(self._policies) * (PLANS_PART - 1) // PLANS_PART
            if records.samples:
                self._let_go(records, records.samples[-1][0])


def _size(record: RawSample) -> int:
    return len(record[2]) + len(record[3]) + len(record[4]) + OVERHEAD
