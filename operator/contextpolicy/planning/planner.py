"""Samples, placements and due timers in, plans out: Procedure 1 of the paper, lines 12 to 16, for one policy."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.planning.conditions.context import ContextState
from contextpolicy.planning.conditions.initiative import Initiative
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.planning.conditions.scores import Scores
from contextpolicy.planning.conditions.stream import StreamState
from contextpolicy.planning.conditions.timers import SAME_INSTANT, Timers
from contextpolicy.planning.inheritance import Inheritance
from contextpolicy.planning.inputs import Gone, Input, Score
from contextpolicy.planning.plan_maker import PlanMaker
from contextpolicy.policy.fields import LARGEST

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.allocation.weights import Weight
    from contextpolicy.planning.conditions.expressions import Waiting
    from contextpolicy.policy.spec import Policy


class HealthListener(Protocol):
    """What hears that the status has news even when no plan changes."""

    def on_health(self) -> None:
        """A stream fell silent, is heard again or changed its clock, or an expression began or ceased to fail."""


class Planner:
    """All state of one policy that depends on what happened; a sample touches only what reads its stream.

    Every method that can lead to plans takes `now` and returns the new plans, oldest first: one for each instant at
    which a due timer or the input changed something. A plan with a new sequence number is to be carried out; one with
    that of the last only shows how scores, weights and contexts went on. Unchanged plans are not returned.
    """

    def __init__(self, policy: Policy, listener: HealthListener | None = None) -> None:
        self.policy = policy
        self._listener = listener
        self.timers = Timers()
        self.drops: Counter[tuple[str, str]] = Counter()
        self.errors: dict[str, str] = {}
        self.transitions: Counter[str] = Counter()
        """How often each context began or ceased to hold."""
        self.started = False
        self._maker = PlanMaker(policy, self.timers)
        scope = Scope()
        self.streams = {s.name: StreamState(s, scope, self.timers, self) for s in policy.streams}
        self._scores = Scores(policy, lambda spec: Initiative(spec, self.streams, scope, self.timers, self))
        self.initiatives, self.requirements = self._scores.initiatives, self._scores.requirements
        self.contexts = [ContextState(c, self.streams, scope, self.timers, self) for c in policy.contexts]
        self._readers = self._index()
        self._release = _Release(self)

    def start(self, now: float, before: Planner | None = None) -> list[Plan]:
        """Start the watchdogs, and decide what needs no sample.

        `before` is the planner of the policy's previous version: what the edit did not change keeps its state, unless
        that version never started.
        """
        self.started = True
        former = before.inheritance() if before and before.started else Inheritance({}, (), ())
        for stream in self.streams.values():
            stream.start(now)
            former.pass_on_stream(stream, now)
        self._fall_back(now)
        for initiative, task in self.owned_initiatives():
            if former.pass_on_initiative(initiative, task, now):
                self._scores.update(initiative)
            else:
                initiative.start(now)
        for context in self.contexts:
            if not former.pass_on_context(context, now):
                context.start(now)
        self._force(now)
        self._maker.begin(self)
        return self._conclude(now)

    def handle(self, event: Input, now: float) -> list[Plan]:
        """Take an input; timers due before it act first, each at its own instant.

        What is due at this very instant acts after it, so that an event that comes just in time counts.
        """
        plans: list[Plan] = []
        self._let_act(now - SAME_INSTANT, plans)
        due_now = self.timers.next_due(now) is not None
        arrived = None
        match event:
            case Sample():
                arrived = event.arrived
                self._observe(event, now)
            case Placement():
                self._maker.place(event)
            case Gone():
                if event.stream in self.streams:
                    self.streams[event.stream].lose(now)
            case Score():
                arrived = event.arrived
                self._set_score(event, now)
        if due_now:
            self.timers.fire(now)
        return plans + self._conclude(now, arrived)

    def advance(self, now: float) -> list[Plan]:
        """Let every timer due by now act."""
        plans: list[Plan] = []
        self._let_act(now, plans)
        return plans

    def next_due(self, by: float = math.inf) -> float | None:
        """When `advance` is to be called next, if nothing else happens; None when that is not before `by`."""
        return self.timers.next_due(by)

    def on_value(self, stream: StreamState, now: float) -> None:
        """A stream has a new value: ask its readers only."""
        for reader in self._readers[stream.spec.name]:
            reader.on_value(now)

    def on_silence(self, stream: StreamState, now: float) -> None:
        """A stream fell silent."""
        for reader in self._readers[stream.spec.name]:
            reader.on_value(now)
        self._fall_back(now)
        self._maker.note(stream, f"{stream.spec.name}: silent")
        self._report_health()

    def on_recovery(self, stream: StreamState, now: float) -> None:
        """A silent stream is heard again."""
        self._fall_back(now)
        self._maker.note(stream, f"{stream.spec.name}: heard again")
        self._report_health()

    def on_first_value(self, stream: StreamState) -> None:  # noqa: ARG002 - the listener's signature
        """A stream without a value has one: nothing waits for it any more."""
        self._report_health()

    def on_unheard(self, stream: StreamState) -> None:  # noqa: ARG002 - the listener's signature
        """A stream without a watchdog had no sample for an hour, or is heard again."""
        self._report_health()

    def on_clock(self, stream: StreamState) -> None:  # noqa: ARG002 - the listener's signature
        """A stream's timestamps no longer count, or count again."""
        self._report_health()

    def on_drop(self, stream: str, reason: str, detail: str = "") -> None:  # noqa: ARG002 - the listener's signature
        """Count a sample that was not used."""
        self.drops[stream, reason] += 1

    def on_expression_error(self, source: str, reason: str) -> None:
        """Count a failure of an expression or a plugged-in function; keep the latest message for the status."""
        self.drops["", "expression"] += 1
        known = source in self.errors
        self.errors[source] = reason
        if not known:
            self._report_health()

    def on_expression_recovery(self, source: str) -> None:
        """Drop the error from the status."""
        if self.errors.pop(source, None) is not None:
            self._report_health()

    def on_score(self, initiative: Initiative, now: float) -> None:  # noqa: ARG002 - the listener's signature
        """An activity or a pre-condition changed."""
        self._scores.update(initiative)
        self._maker.note(initiative, f"{initiative.source}: {initiative.spec.when} is {initiative.value:g}")

    def on_context(self, context: ContextState, now: float) -> None:  # noqa: ARG002 - the listener's signature
        """A context began or ceased to hold."""
        self.transitions[context.spec.name] += 1
        source = ", ".join([stream.spec.name for stream in context.streams]) or "policy"
        self._maker.note(context, f"{source}: context {context.spec.name} {'entered' if context.active else 'exited'}")

    def at_rest(self) -> Mapping[str, Weight]:
        """What the tasks would weigh now if all were active."""
        return self._maker.at_rest()

    @property
    def placement(self) -> Placement:
        """Where the containers run, as of the last placement received."""
        return self._maker.placement

    @property
    def last(self) -> Plan | None:
        """What is true now: the shares in force, the weights and contexts of this moment."""
        return self._maker.last

    @property
    def decided(self) -> Plan | None:
        """The plan with which the shares in force began."""
        return self._maker.decided

    @property
    def held_back(self) -> int:
        """How many plans minDwell held back."""
        return self._maker.held_back

    @property
    def weights(self) -> Mapping[str, Weight]:
        """The weights of this moment."""
        return self._maker.weights

    def scores(self) -> dict[str, float]:
        """Each task's score now."""
        return dict(self._scores.of)

    def owned_initiatives(self) -> Iterable[tuple[Initiative, str]]:
        """All activities and pre-conditions, each with its task."""
        return self._scores.owned()

    def inheritance(self) -> Inheritance:
        """What the planner of the policy's next version may take over."""
        return Inheritance(self.streams, self.contexts, self.owned_initiatives())

    def waits(self) -> Iterator[tuple[str, Waiting]]:
        """What can't be decided now: the task or context, and what it waits for."""
        for initiative, task in self.owned_initiatives():
            for own in (initiative.when, initiative.score):
                if own and own.waiting:
                    yield f"task {task}", own.waiting
        for context in self.contexts:
            if context.when and context.when.waiting:
                yield f"context {context.spec.name}", context.when.waiting

    def active_contexts(self) -> list[ContextState]:
        """The contexts that have effects now, in list order."""
        return [context for context in self.contexts if context.active]

    def _report_health(self) -> None:
        if self._listener is not None:
            self._listener.on_health()

    def _let_act(self, now: float, plans: list[Plan]) -> None:
        """Let every timer due by now act, collecting the plans."""
        while (due := self.timers.next_due(now)) is not None:
            self.timers.fire(due)
            plans += self._conclude(due)

    def _index(self) -> dict[str, list[Initiative | ContextState]]:
        readers: dict[str, list[Initiative | ContextState]] = defaultdict(list)
        all_readers: list[Initiative | ContextState] = [*self._scores, *self.contexts]
        for reader in all_readers:
            for stream in reader.streams:
                readers[stream.spec.name].append(reader)
        return readers

    def _observe(self, sample: Sample, now: float) -> None:
        stream = self.streams.get(sample.stream)
        if stream is None:
            self.on_drop(sample.stream, "unknown stream")
        else:
            stream.observe(sample, now)

    def _set_score(self, score: Score, now: float) -> None:
        # Plugged-in functions are foreign code: they may emit NaN, infinity, or no number at all.
        if isinstance(score.value, int | float) and abs(score.value) <= LARGEST:
            self.initiatives[score.task][score.activity].set(float(score.value), now)
        else:
            self.on_drop(score.task, "score not finite")

    def _fall_back(self, now: float) -> None:
        silent = any(stream.silent for stream in self.streams.values())
        for context in self.contexts:
            if context.spec.name == self.policy.fallback:
                (context.insist if silent else context.relent)("fallback", now)

    def _force(self, now: float) -> None:
        force = self.policy.force
        for context in self.contexts:
            if force is not None and context.spec.name == force.context and now < force.until:
                context.insist("forced", now)
                self.timers.set(self._release, force.until)

    def _conclude(self, now: float, arrived: float | None = None) -> list[Plan]:
        """The new plan, if something changed.

        The first plan waits until each stream with a watchdog is heard or silent: until then a restarted operator
        leaves the limits as they are.
        """
        maker = self._maker
        if not maker.changed or (maker.last is None and any(stream.unknown for stream in self.streams.values())):
            return []
        plan = maker.make(self._scores, [context.spec for context in self.active_contexts()], now, arrived)
        return [] if plan is None else [plan]


class _Release:
    """The end of a context that was forced by hand."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner

    def on_due(self, now: float) -> None:
        for context in self._planner.contexts:
            context.relent("forced", now)
