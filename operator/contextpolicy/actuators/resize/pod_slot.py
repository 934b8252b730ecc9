"""What the resizer knows of one pod: what was asked, what the API has, what the kubelet says is in force. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.contest import Governed
from contextpolicy.actuators.resize.headroom import Holding
from contextpolicy.actuators.resize.oversight import Oversight, beside
from contextpolicy.actuators.resize.pauses import FAILED, REFUSED
from contextpolicy.cluster.claims import container_id
from contextpolicy.cluster.pods import Cpu, Original

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from contextpolicy.actuators.resize.pod_job import Job, Outcome
    from contextpolicy.cluster.pods import ContainerView, PodView


SETTLING = 0.3
"""Seconds for which a newer wish waits for the kubelet to be done with the last: it takes one resize of a pod after the
other, and in a storm of contexts each that is overtaken only delays the newest."""


@dataclass(frozen=True, slots=True)
class _Refusal:
    """A wish that the API refused so many times in a row; it is not asked for again before `until`."""

    wanted: Mapping[str, Cpu]
    times: int
    until: float


@dataclass(slots=True)
class PodSlot:
    """One pod; at most one job is under way (or waits to be tried again), newer wishes wait for its end.

    `version` is that of our last write: a view from before it is old news. `unsure` holds after a job whose outcome
    nobody knows until one is answered; `maybe` is the note that it may have left. `peaks` are limits that may still be
    in force; `lowered` are the containers put back, by the policy that had them, until they are in force. `governed`
    are the containers that policies decide about now. `troubled` are the policies that were told of a problem.
    """

    view: PodView
    job: Job | None = None
    attempts: int = 0
    version: int = 0
    unsure: bool = False
    maybe: dict[str, Original] = field(default_factory=dict)
    asked: dict[str, Cpu] = field(default_factory=dict)
    peaks: dict[str, int] = field(default_factory=dict)
    lowered: dict[str, str] = field(default_factory=dict)
    governed: dict[str, Governed] = field(default_factory=dict)
    troubled: set[str] = field(default_factory=set)
    oversight: Oversight = field(default_factory=Oversight)
    _resized_at: float = -inf
    _refused: dict[tuple[str, bool], _Refusal] = field(default_factory=dict)

    def observe(self, view: PodView, now: float) -> None:
        """Take what the watch says, unless we have written since."""
        if view.version < self.version:
            return
        if view.generation != self.view.generation:
            self._refused.clear()
            self._keep_peaks(view)
        self.view = view
        self.oversight.look(view, now)
        self._settle()

    def begin(self, job: Job) -> None:
        """A job is on its way: from now on its limits may be in force."""
        for name in job.changed:
            self.peaks[name] = self.highest(name)
        self.job = job

    def finish(self, job: Job, outcome: Outcome, now: float) -> float:
        """Learn how far it came; returns the seconds until it may be tried again, if it failed.

        After an error that a retry may mend it stays under way until then.
        """
        self._learn(job, outcome)
        if outcome.resized or (outcome.error is not None and outcome.error.retriable):
            self.peaks |= {name: self.highest(name) for name in job.changed}
        if outcome.resized:
            self._resized_at = now
        pause = 0.0
        if outcome.error is None:
            self.job, self.attempts, self.unsure, self.maybe = None, 0, False, {}
            self._refused.pop((job.policy, job.restore), None)
        elif outcome.error.retriable:
            self.attempts, self.unsure = self.attempts + 1, True
            self.maybe |= {} if job.restore else job.originals
            pause = max(FAILED.after(self.attempts), outcome.error.retry_after)
        else:
            self.job = None
            pause = self._refuse(job, now)
        self._settle()
        return pause

    def refuses(self, policy: str, wanted: Mapping[str, Cpu], now: float, *, restore: bool) -> bool:
        """Whether the API has just refused this; another wish, or a change of the pod, may be asked for at once."""
        refusal = self._refused.get((policy, restore))
        if refusal is not None and refusal.wanted != wanted:
            del self._refused[policy, restore]
            return False
        return refusal is not None and now < refusal.until

    def settling(self, now: float) -> bool:
        """Whether the kubelet, as far as is known, is still at our last resize; for one that waits, nothing does."""
        return bool(self.peaks) and not self.view.pending and now < self._resized_at + SETTLING

    def ask_again(self, policy: str, *, restore: bool) -> None:
        """Let what was refused be tried once more."""
        self._refused.pop((policy, restore), None)

    def step(self, container: ContainerView, wanted: Cpu, now: float) -> Cpu:
        """What to ask for: what is wanted, or what is beside it when the kubelet has overlooked that."""
        overlooked = now >= self.oversight.until and self.spec(container.name) == wanted
        return beside(container, wanted) if overlooked else wanted

    def spec(self, name: str) -> Cpu | None:
        """The container's resources in the API, counting what the watch has not shown yet; None when nobody knows."""
        if self.unsure:
            return None
        container = self.view.container(name)
        return self.asked.get(name) or (container.spec if container else None)

    def holding(self, name: str, wanted: Cpu) -> Holding:
        """The container's limits as the node's headroom counts them."""
        container, asked = self.view.container(name), self.asked.get(name)
        spec = asked or (container.spec if container else None)
        return Holding(f"{self.view.uid}/{name}", (spec and spec.limit) or 0, self.highest(name), wanted.limit or 0)

    def let_go(self, policy: str, claimed: Collection[str]) -> None:
        """Whatever the policy decided about and claims no more is not its any more."""
        lost = [
            name
            for name, governed in self.governed.items()
            if governed.policy == policy and (self.view.ended or container_id(self.view, name) not in claimed)
        ]
        for name in lost:
            del self.governed[name]

    def rests(self, name: str, now: float) -> bool:
        """Whether a container is left for a while as somebody else has made it."""
        return name in self.governed and self.governed[name].rests(now)

    def before(self, name: str) -> Cpu | None:
        """What a container had before us; None when nobody knows yet."""
        original, governed = self.originals.get(name), self.governed.get(name)
        return original.cpu if original else governed.cpu if governed else None

    def highest(self, name: str) -> int:
        """The highest limit that may be in force now."""
        container, asked = self.view.container(name), self.asked.get(name)
        changing = self.job.changed.get(name) if self.job else None
        known = (asked, changing, container.spec, container.actual) if container else (asked, changing)
        return max(self.peaks.get(name, 0), *((cpu.limit or 0) if cpu else 0 for cpu in known))

    @property
    def originals(self) -> dict[str, Original]:
        """What the containers had before us, as far as it is, or may be, written down in the pod."""
        return {**self.maybe, **self.view.originals}

    def note(self, policy: str, names: set[str]) -> dict[str, Original]:
        """The originals with those of `names`, which are the policy's from now on."""
        known = self.originals
        for name in names:
            container = self.view.container(name)
            if name in known:
                known[name] = replace(known[name], policy=policy)
            elif container is not None:
                known[name] = Original(policy, self.before(name) or self.asked.get(name) or container.spec)
        return known

    def holds(self, policy: str) -> bool:
        """Whether the policy moved, or may yet move, anything in this pod."""
        if self.view.ended:
            return False
        under_way = self.job is not None and self.job.policy == policy
        return under_way or any(original.policy == policy for original in self.originals.values())

    def _keep_peaks(self, view: PodView) -> None:
        """Somebody's resize replaces another before the kubelet told about it: either may be in force."""
        for container in view.containers:
            if container.spec != self.spec(container.name):
                self.peaks[container.name] = max(self.highest(container.name), container.spec.limit or 0)

    def _refuse(self, job: Job, now: float) -> float:
        before = self._refused.get((job.policy, job.restore))
        times = before.times + 1 if before is not None and before.wanted == job.wanted else 1
        pause = REFUSED.after(times)
        self._refused[job.policy, job.restore] = _Refusal(job.wanted, times, now + pause)
        return pause

    def _learn(self, job: Job, outcome: Outcome) -> None:
        """What was answered is known, however the job ended."""
        self.version = max(self.version, outcome.version)
        if outcome.resized:
            self.asked |= job.changed
            self.oversight.nudged()
        if outcome.resized and not job.restore:
            for name, cpu in job.changed.items():
                self.governed.setdefault(name, Governed(job.policy, cpu)).give(job.policy, cpu)
        if outcome.noted and job.restore:
            self.lowered |= dict.fromkeys(job.wanted, job.policy)
        if outcome.noted and self.view.version < self.version:
            self.view = replace(self.view, originals=job.originals)

    def _settle(self) -> None:
        """Forget what has passed: the API's answers once the watch shows them, peaks once the kubelet is done."""
        if self.job is not None or self.unsure or self.view.version < self.version:
            return
        self.asked = {}
        settled = self.view.seen and all(container.in_force for container in self.view.containers)
        if settled and not self.view.pending:
            self.peaks, self.lowered = {}, {}
