"""Samples, placements and due timers in, plans out: Procedure 1 of the paper, lines 12 to 16, for one policy."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Protocol

from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.planning.conditions.context import ContextState
from contextpolicy.planning.conditions.evaluation import Evaluation
from contextpolicy.planning.conditions.initiative import Initiative
from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.planning.conditions.scores import Scores
from contextpolicy.planning.conditions.stream import StreamState
from contextpolicy.planning.conditions.timers import SAME_INSTANT, Timers
from contextpolicy.planning.inheritance import Inheritance
from contextpolicy.planning.inputs import ClockSet, Gone, Input, Score
from contextpolicy.planning.overrides import Overrides
from contextpolicy.planning.plan_maker import PlanMaker
from contextpolicy.planning.restart import Restart, RestartState

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.allocation.seating import Seating
    from contextpolicy.planning.allocation.weights import Weight
    from contextpolicy.planning.conditions import expressions
    from contextpolicy.planning.restart import Remembered
    from contextpolicy.policy.spec import Policy


class HealthListener(Protocol):
    """Receives changes of the status that come without a plan."""

    def on_health(self) -> None:
        """A stream fell silent, is heard again or changed its clock, or an expression began or ceased to fail."""


class Planner:
    """All state of one policy that depends on what happened; a sample touches only what reads its stream.

    Every method that can lead to plans takes `now` and returns the new plans, oldest first: one for each instant at
    which a due timer or the input changed something. A plan with a new sequence number is to be carried out; one with
    that of the last only shows how scores, weights and contexts went on. Unchanged plans are not returned.
    """

    def __init__(self, policy: Policy, listener: HealthListener, remembered: Mapping[str, Remembered]) -> None:
        """`remembered` is what the tasks had before a restart of the operator."""
        self.policy = policy
        self._listener = listener
        self.timers = Timers()
        self.drops: Counter[tuple[str, str]] = Counter()
        self.errors: dict[str, str] = {}
        self.transitions: Counter[str] = Counter()
        """How often each context began or ceased to hold."""
        self.started = False
        self._maker = PlanMaker(policy, self.timers)
        self._scope = scope = Scope()
        self.streams = {s.name: StreamState(s, scope, self.timers, self) for s in policy.streams}
        self._scores = Scores(policy, lambda spec: Initiative(spec, self.streams, scope, self.timers, self))
        self.initiatives, self.requirements = self._scores.initiatives, self._scores.requirements
        self.contexts = [ContextState(c, self.streams, scope, self.timers, self) for c in policy.contexts]
        self._evaluation = Evaluation(self._scores, self.contexts)
        self._overrides = Overrides(policy, self.streams.values(), self.contexts, self.timers)
        self._firing = False
        self.restart = Restart(policy, remembered, self.timers, self)

    def start(self, now: float, before: Planner | None = None, ahead: float = 0.0) -> list[Plan]:
        """Start the watchdogs, and decide what needs no sample. `ahead`: see `ClockSet`.

        `before` is the planner of the policy's previous version: what the edit did not change keeps its state, unless
        that version never started.
        """
        self.started = True
        former = before.inheritance() if before and before.started else Inheritance({}, (), ())
        for stream in self.streams.values():
            stream.start(now)
            former.pass_on_stream(stream, now)
        self._overrides.fall_back(now)
        self._overrides.force(now, ahead)
        # What was active before the edit has not turned: readers hear of a context when it starts or is passed on.
        self._evaluation.waiting.clear()
        self.transitions.clear()
        for reader in self._evaluation.readers:
            if not former.pass_on(reader, self._scores, now):
                reader.start(now)
        state = RestartState(self.streams, self.contexts, self.owned_initiatives(), self._overrides.forced())
        self.restart.start(before.restart if before else None, state, now)
        self._maker.kept = self.restart.kept
        self._maker.begin(self)
        return self._conclude(now)

    def handle(self, event: Input, now: float) -> list[Plan]:
        """Take an input; timers due before it act first, each at its own instant.

        What is due at this very instant acts after it, so that an event that comes just in time counts.
        """
        plans: list[Plan] = []
        due_now = self.timers.next_due(now) is not None
        if due_now:  # hardly ever, when a sample comes
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
            case ClockSet():
                self._overrides.force(now, event.ahead)
            case Score():
                arrived = event.arrived
                self._set_score(event, now)
        if due_now:
            self._evaluation.follow(now)
            self._fire(now)
        return plans + self._conclude(now, arrived)

    def advance(self, now: float) -> list[Plan]:
        """Let every timer due by now act."""
        plans: list[Plan] = []
        self._let_act(now, plans)
        return plans

    def next_due(self, by: float = math.inf) -> float | None:
        """When `advance` is to be called next, if nothing else happens; None when that is not before `by`."""
        return self.timers.next_due(by)

    def on_sample(self, stream: StreamState, now: float) -> None:
        """A sample came: ask the stream's readers only."""
        if self._firing:
            self._evaluation.wait(stream.spec.name, sampled=True)
            return
        for reader in self._evaluation.of_stream[stream.spec.name]:
            reader.on_value(now, sampled=True)

    def on_slide(self, stream: StreamState) -> None:
        """A window slid: what its readers see may have changed, but nothing happened."""
        self._evaluation.wait(stream.spec.name)

    def on_silence(self, stream: StreamState, now: float) -> None:
        """A stream fell silent."""
        self._evaluation.wait(stream.spec.name)
        self._overrides.fall_back(now, stream=stream.spec.name)
        self.restart.know(stream.spec.name)
        self._maker.note(stream, f"{stream.spec.name}: silent")
        self._listener.on_health()

    def on_recovery(self, stream: StreamState, now: float) -> None:
        """A silent stream is heard again."""
        self._overrides.fall_back(now, stream=stream.spec.name, sampled=True)
        self._maker.note(stream, f"{stream.spec.name}: heard again")
        self._listener.on_health()

    def on_first_value(self, stream: StreamState) -> None:
        """A stream without a value has one: nothing waits for it any more."""
        if self.restart.awaited:
            self.restart.know(stream.spec.name)
        self._listener.on_health()

    def on_unheard(self, stream: StreamState) -> None:  # noqa: ARG002 - the listener's signature
        """A stream without a watchdog had no sample for an hour, or is heard again."""
        self._listener.on_health()

    def on_clock(self, stream: StreamState) -> None:  # noqa: ARG002 - the listener's signature
        """A stream's timestamps no longer count, or count again."""
        self._listener.on_health()

    def on_known(self, stream: str) -> None:
        """Tasks that kept their state of before a restart are decided again."""
        self._maker.kept = self.restart.kept
        self._maker.note(self.restart, f"{stream}: known again after the restart")

    def on_drop(self, stream: str, reason: str, detail: str = "") -> None:  # noqa: ARG002 - the listener's signature
        """Count a sample that was not used."""
        self.drops[stream, reason] += 1

    def on_expression_error(self, source: str, reason: str) -> None:
        """Count a failure of an expression or a plugged-in function; keep the latest message for the status."""
        self.drops["", "expression"] += 1
        known = source in self.errors
        self.errors[source] = reason
        if not known:
            self._listener.on_health()

    def on_expression_recovery(self, source: str) -> None:
        """Drop the error from the status."""
        if self.errors.pop(source, None) is not None:
            self._listener.on_health()

    def on_elapsed(self, reader: expressions.Reader) -> None:
        """A delay or an age that a reader waited for is over."""
        self._evaluation.elapse(reader)

    def on_score(self, initiative: Initiative, now: float) -> None:  # noqa: ARG002 - the listener's signature
        """An activity or a pre-condition changed: a cause only where its task changes with it."""
        if self._scores.update(initiative):
            self._maker.note(self._scores.part(initiative), self._scores.cause(initiative))

    def on_context(self, context: ContextState, now: float) -> None:  # noqa: ARG002 - the listener's signature
        """A context began or ceased to hold."""
        self.transitions[context.spec.name] += 1
        if context.spec.name in self._scope.active:
            self._scope.show_context(context.spec.name, active=context.active, by_sample=context.by_sample)
            self._evaluation.on_context(context.spec.name)
        turned = "entered" if context.active else "exited"
        self._maker.note(context, f"{context.moved_by}: context {context.spec.name} {turned}")

    def at_rest(self) -> Mapping[str, Weight]:
        """What the tasks would weigh now if all were active."""
        return self._maker.at_rest()

    def seating(self) -> Seating:
        """Where the tasks run, within the bounds of the contexts that are active now."""
        return self._maker.seating([context.spec for context in self.active_contexts()])

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

    def active_contexts(self) -> list[ContextState]:
        """The contexts that have effects now, in list order."""
        return [context for context in self.contexts if context.active]

    def _let_act(self, now: float, plans: list[Plan]) -> None:
        """Let every timer due by now act, collecting the plans."""
        while (due := self.timers.next_due(now)) is not None:
            self._fire(due)
            plans += self._conclude(due)

    def _fire(self, now: float) -> None:
        """Let all that is due act; conditions are evaluated when all of it has."""
        self._firing = True
        self.timers.fire(now)
        self._firing = False

    def _observe(self, sample: Sample, now: float) -> None:
        stream = self.streams.get(sample.stream)
        if stream is None:
            self.on_drop(sample.stream, "unknown stream")
        else:
            stream.observe(sample, now)

    def _set_score(self, score: Score, now: float) -> None:
        if score.is_number:
            self.initiatives[score.task][score.activity].set(float(score.value), now)
        else:
            self.on_drop(score.task, "score not finite")

    def _conclude(self, now: float, arrived: float | None = None) -> list[Plan]:
        """The new plan, if something changed."""
        if self._evaluation.waiting:
            self._evaluation.follow(now)
        maker = self._maker
        if not maker.changed:
            return []
        contexts = [context.spec for context in self.contexts if context.active]
        plan = maker.make(self._scores, contexts, now, arrived)
        return [] if plan is None else [plan]
