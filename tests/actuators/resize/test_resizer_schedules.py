"""Whatever the order of plans, patches, kubelet and watch: never above N, and in the end what was asked last.

The kubelet is a model of its own: it may act on any version of a spec, as late as it likes.
"""

from __future__ import annotations

import random

import pytest

from tests.actuators.resize.fake_cluster import UNREACHABLE, Killed, Unanswered, refusal
from tests.actuators.resize.rig import POLICY, Rig, by_id
from tests.cluster.builders import a_pod, cpu

OTHER = "lab/other"
PODS = {
    "slam": {"slam": cpu("10m", "300m"), "map": cpu("10m", "100m")},
    "speech": {"speech": cpu("10m", "300m")},
    "nav": {"nav": cpu("10m", "200m"), "plan": cpu("10m", "100m")},
}
OWN = {POLICY: ("slam__slam", "speech__speech", "nav__nav"), OTHER: ("slam__map", "nav__plan")}
N = {POLICY: 800, OTHER: 200}
FAULTS = (
    *(UNREACHABLE, Unanswered(UNREACHABLE), refusal("Conflict", retriable=True), refusal("Invalid")),
    *(Killed(), Unanswered(Killed())),
)
STEPS = 150


class World:
    """One node, two policies that share pods, and everything that can happen, in random order."""

    def __init__(self, seed: int, *, mood: str, observed_generation: bool) -> None:
        self.random = random.Random(seed)  # noqa: S311 - the same schedules in every run
        self.mood, self.calm, self.reports_version = mood, mood != "faulty", observed_generation
        self.rig = Rig(
            *(a_pod(name, own) for name, own in PODS.items()), stores=True, observed_generation=observed_generation
        )
        self.cluster = self.rig.cluster
        self.targets: dict[str, dict[str, int]] = {}
        self.bounded: set[str] = set()
        self.under_way = False
        self.bound = self._highest()

    def run(self) -> None:
        acts = [
            *((self.patch, 40), (self.kubelet, 30), (self.report, 30), (self.watch, 60), (self.skip, 2)),
            (self.plan, 12),
            *MOODS[self.mood](self),
        ]
        if self.mood == "contested":
            self.targets = {policy: dict.fromkeys(own, N[policy] // 30 * 10) for policy, own in OWN.items()}
            self.settle()
        for act in self.random.choices([act for act, _ in acts], [weight for _, weight in acts], k=STEPS):
            act()
            self.check()

    def plan(self) -> None:
        policy = self.random.choice([POLICY, OTHER])
        parts = [self.random.choice([1, 5, 20]) for _ in OWN[policy]]
        units = N[policy] // 10
        self.targets[policy] = {
            name: max(1, units * part // sum(parts)) * 10 for name, part in zip(OWN[policy], parts, strict=True)
        }
        self.notify(policy)

    def release(self) -> None:
        """What was there before is not above N either; where the kubelet takes its time, N counts no longer."""
        policy = self.random.choice([POLICY, OTHER])
        self.targets.pop(policy, None)
        if self.mood == "faulty":
            self.bounded.discard(policy)
        self.notify(policy)

    def patch(self) -> None:
        """A worker carries a patch out, while the watch reports each of its steps or stays silent."""
        if not self.rig.workers.jobs:
            return
        faulty = not self.calm and self.random.random() < 0.3
        self.cluster.faults.extend(self.random.choices([None, *FAULTS], k=3) if faulty else ())
        self.cluster.on_call = self.random.choice([self.rig.watch, self.check])
        index = self.random.randrange(len(self.rig.workers.jobs))
        self.under_way = True
        lives = self.rig.survive(lambda: self.rig.work(index))
        self.under_way = False
        self.cluster.faults.clear()
        self.cluster.on_call = lambda: None
        if not lives:
            self.restart()

    def kubelet(self) -> None:
        """The kubelet acts on a version that it has not acted on yet, perhaps not the newest."""
        uid = self.uid()
        generation, *_ = self.random.choice(self.cluster._specs[uid])
        self.cluster.kubelet(uid, generation)

    def report(self) -> None:
        self.cluster.report(self.uid())

    def watch(self) -> None:
        uid = self.uid()
        if self.cluster.feeds[uid]:
            self.rig.watch_one(uid)

    def skip(self) -> None:
        """A watch that falls behind leaves versions out."""
        feed = self.cluster.feeds[self.uid()]
        if len(feed) > 1:
            feed.popleft()

    def meddle(self) -> None:
        """Another writer resizes a container; that is not ours, but from when it is known we add nothing to it."""
        pod = self.random.choice(list(PODS))
        container = self.random.choice(list(PODS[pod]))
        self.rig.watch(f"uid-{pod}")
        if self.rig.workers.jobs:  # sent before it is known
            return
        self.cluster.edit(f"uid-{pod}", container, cpu=f"{self.random.choice([50, 300, 700])}m")
        self.rig.watch(f"uid-{pod}")
        self.bound = self._highest()

    def wait(self) -> None:
        self.rig.wait(self.random.choice([0.01, 0.2, 1.0, 10.0]))

    def kill(self) -> None:
        self.rig.kill()
        self.restart()

    def restart(self) -> None:
        """The next operator can't know which versions the kubelet has yet to act on; until it runs, it has."""
        for uid in self.cluster.pods:
            self.cluster.kubelet(uid)
        self.tell_all()

    def uid(self) -> str:
        return f"uid-{self.random.choice(list(PODS))}"

    def notify(self, policy: str) -> None:
        if policy in self.targets:
            self.rig.order(policy, by_id(self.targets[policy]), n=N[policy])
        else:
            self.rig.release(policy)

    def tell_all(self) -> None:
        """What the watch of policies reports to a new operator; a deletion that is not finished is asked for again."""
        for policy in OWN:
            self.notify(policy)

    def check(self) -> None:
        """A policy bounds its containers from when they are within N, and no patch of a restore is under way.

        If the kubelet does not report which version it reports on, up and down again looks like nothing at all.
        """
        before, self.bound = self.bound, self._highest()
        quiet = not self.under_way and not self.rig.workers.jobs
        for policy, bound in self.bound.items():
            if policy in self.targets and bound <= N[policy] and quiet:
                self.bounded.add(policy)
            allowed = max(N[policy], before[policy])
            bounded = policy in self.bounded and self.reports_version
            assert not bounded or bound <= allowed, f"{policy}: {bound}m of {N[policy]}m"

    def settle(self) -> None:
        for policy, target in self.targets.items():
            self.rig.hold(policy, **target)  # what was refused is only asked again after the target has changed
        self.tell_all()
        self.rig.settle()

    def _highest(self) -> dict[str, int]:
        """The most that each policy's containers together may have at some instant, as it stands."""
        return {
            policy: sum(self.cluster.highest(f"uid-{pod}")[name] for pod, _, name in (c.partition("__") for c in own))
            for policy, own in OWN.items()
        }


MOODS = {
    "calm": lambda world: [(world.wait, 10)],
    "restoring": lambda world: [(world.release, 4)],  # no time passes: nobody loses patience
    "contested": lambda world: [(world.wait, 10), (world.meddle, 4)],
    "faulty": lambda world: [(world.wait, 10), (world.release, 2), (world.kill, 1)],
}


def original(name: str) -> int:
    pod, _, container = name.partition("__")
    return int(PODS[pod][container]["limits"]["cpu"][:-1])


@pytest.mark.parametrize("observed_generation", [True, False], ids=["1.35", "1.33"])
@pytest.mark.parametrize("mood", MOODS)
@pytest.mark.parametrize("seed", range(12))
def test_limits_never_sum_above_n_and_end_as_asked(seed, mood, observed_generation):
    world = World(seed, mood=mood, observed_generation=observed_generation)
    world.run()
    world.settle()
    for policy, own in OWN.items():
        target = world.targets.get(policy)
        for name in own:
            pod, _, container = name.partition("__")
            limit = world.cluster.limits(f"uid-{pod}")[container]
            note = world.cluster.originals(f"uid-{pod}").get(container)
            assert limit == (target[name] if target else original(name))
            assert note.cpu.limit == original(name) if note else limit == original(name)
            assert target or note is None
