"""The ContextPolicy resource as frozen values, valid by construction (see `parsing`); `field_types` has the units."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Self

from contextpolicy.policy.activities import Needs
from contextpolicy.policy.bandwidth import PERIOD

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.policy.activities import Activity, Requirement
    from contextpolicy.policy.field_types import Cel, Cpu, Seconds, Weighting
    from contextpolicy.policy.selectors import Selector
    from contextpolicy.policy.stream_spec import Stream


class Mode(StrEnum):
    """What happens with a plan: carried out, only reported, or not made at all."""

    decides: bool
    """Whether plans are made."""
    acts: bool
    """Whether plans are carried out: a policy claims its containers then, and each has only one."""

    def __new__(cls, name: str, decides: bool, acts: bool) -> Self:  # noqa: FBT001 - a row of the table
        """A mode by its name in `spec.mode`."""
        mode = str.__new__(cls, name)
        mode._value_ = name
        mode.decides, mode.acts = decides, acts
        return mode

    ENFORCE = ("Enforce", True, True)
    DRY_RUN = ("DryRun", True, False)
    PAUSED = ("Paused", False, False)


class Scheduler(StrEnum):
    """Which of the paper's schedulers divides the CPU (IV-C)."""

    CFS = "CFS"
    REALTIME = "Realtime"


class Control(StrEnum):
    """How shares are enforced under CFS: not at all but for suspension, by weights, or by limits (the paper)."""

    SUSPEND = "Suspend"
    WEIGHT = "Weight"
    LIMIT = "Limit"


class Transition(StrEnum):
    """How a node gets from one plan to the next: all limits at once, or each rise after the falls that pay for it."""

    PROMPT = "Prompt"
    STRICT = "Strict"


class RealtimeFallback(StrEnum):
    """What a node without realtime group scheduling does with a Realtime policy."""

    CFS = "CFS"
    NONE = "None"


class RealtimePolicy(StrEnum):
    """How realtime threads of one priority share a processor: in turns, or each until it waits (sched(7))."""

    RR = "RR"
    FIFO = "FIFO"


class SatisfiedBy(StrEnum):
    """A compound task needs all of its subtasks, a complex task any of them (paper III)."""

    ALL = "All"
    ANY = "Any"


@dataclass(frozen=True, slots=True)
class Task:
    """A robot function; `idle` is its score while no activity is fresh, None where it has no activity at all.

    Contexts can weight a `protected` one, but nothing can suspend it or put it below its `min`. With
    `restart_on_resize` it accepts that a new share restarts a container whose `resizePolicy` is RestartContainer.
    `suspended_cpu` is what each of its containers keeps while it is suspended. The policy is not ready while a
    `required` one has no pod.
    """

    name: str
    selector: Selector | None = None
    container: str = ""
    priority: Weighting = 1.0
    idle: Weighting | None = None
    min: Cpu = 10
    max: Cpu | None = None
    suspended_cpu: Cpu = 10
    needs: Needs = field(default_factory=Needs)
    activity: tuple[Activity, ...] = ()
    requires: tuple[Requirement, ...] = ()
    subtasks: tuple[str, ...] = ()
    satisfied_by: SatisfiedBy = SatisfiedBy.ALL
    protected: bool = False
    restart_on_resize: bool = False
    required: bool = False

    @property
    def preconditions(self) -> tuple[Requirement, ...]:
        """The requirements that samples decide."""
        return tuple(own for own in self.requires if own.task is None)

    @property
    def required_tasks(self) -> tuple[str, ...]:
        """The tasks without which this one can't run."""
        return tuple(own.task for own in self.requires if own.task is not None)


@dataclass(frozen=True, slots=True)
class Effect:
    """What a context does to one task: at most one of `weight`, `scale` and `suspend`, and bounds.

    `suspend: False` takes back the suspension by a context earlier in the list; it may stand beside another. `min` and
    `max` narrow the task's own bounds.
    """

    weight: Weighting | None = None
    scale: Weighting | None = None
    suspend: bool | None = None
    min: Cpu | None = None
    max: Cpu | None = None

    @property
    def bounds(self) -> bool:
        """Whether it changes the task's bounds."""
        return self.min is not None or self.max is not None

    @property
    def suspends(self) -> bool:
        """Whether it takes all weight from the task, whichever field says so."""
        return self.suspend is True or self.weight == 0 or self.scale == 0


@dataclass(frozen=True, slots=True)
class Context:
    """A named condition over streams that changes weights while it holds.

    It begins by `when` and ends by `until`, or once `when` is false where there is no `until`.
    """

    name: str
    when: Cel | None = None
    until: Cel | None = None
    enter_after: Seconds = 0.0
    exit_after: Seconds = 0.0
    effects: Mapping[str, Effect] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Force:
    """A context that a person makes hold until a moment (Unix seconds), whatever the sensors say."""

    context: str
    until: float


@dataclass(frozen=True, slots=True)
class Shadow:
    """The policy `of` which this one is a shadow, and how many more misses it may cost once it is promoted.

    `tolerance` is a part of a task's inputs, `patience` how long it may miss all of them. `health` is the key
    expression on which modules publish their misses; a task's name stands where it has its `*`.
    """

    of: str
    tolerance: float = 0.05
    patience: Seconds = 5.0
    health: str = "robot/*/health"


@dataclass(frozen=True, slots=True)
class Enforcement:
    """How the kernel is made to honour shares."""

    control: Control = Control.WEIGHT
    scheduler: Scheduler = Scheduler.CFS
    transition: Transition = Transition.PROMPT
    min_dwell: Seconds = 0.0
    period: Seconds = PERIOD
    realtime_fallback: RealtimeFallback = RealtimeFallback.CFS
    realtime_policy: RealtimePolicy = RealtimePolicy.RR


@dataclass(frozen=True, slots=True)
class Policy:
    """One ContextPolicy."""

    namespace: str
    name: str
    tasks: tuple[Task, ...]
    streams: tuple[Stream, ...] = ()
    contexts: tuple[Context, ...] = ()
    mode: Mode = Mode.ENFORCE
    enforcement: Enforcement = field(default_factory=Enforcement)
    reserve: Cpu = 0
    fallback: str | None = None
    force: Force | None = None
    shadow: Shadow | None = None

    @property
    def reference(self) -> str:
        """`namespace/name`, how messages and the decision bus name the policy."""
        return f"{self.namespace}/{self.name}"

    @property
    def leaves(self) -> tuple[Task, ...]:
        """The tasks that run in a container of their own."""
        return tuple(task for task in self.tasks if not task.subtasks)
