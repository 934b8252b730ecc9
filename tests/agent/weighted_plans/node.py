"""A node that is sent weights, the kubelet's writes, and time."""

from __future__ import annotations

import errno
from datetime import timedelta
from time import monotonic

from reactivex.testing import TestScheduler

from contextpolicy.agent.weight_units import of_container
from tests.agent.builders import POLICY, SLAM, SPEECH, Tree, Watch, a_message, a_target, an_agent


class Node:
    """Two tasks and their agent."""

    def __init__(self, folder, layout):
        self.tree = Tree(folder / "cgroup", *layout)
        self.slam, self.speech = self.tree.container(SLAM), self.tree.container(SPEECH)
        self.watch, self._sequence = Watch(), 0
        self._state = folder / "state"
        self.start()

    def start(self):
        """Start an agent; one before it was killed."""
        self.time = TestScheduler()
        self.agent = an_agent(self.tree, self._state, self.time, self.watch)
        self.agent.start()
        self.agent.find_source(POLICY)

    def plan(self, slam, speech, **more):
        """Each is (weight, quota); a weight of 0 is suspended."""
        self._sequence += 1
        targets = [
            a_target(identity, 0.5, task=task, weight=weight, quota=quota, **more)
            for identity, task, (weight, quota) in ((SLAM, "slam", slam), (SPEECH, "speech", speech))
        ]
        suspended = tuple(task for task, (weight, _) in (("slam", slam), ("speech", speech)) if weight == 0)
        return self.agent.hear(POLICY, a_message(*targets, sequence=self._sequence, suspended=suspended))

    def next_message(self, **more):
        """A newer plan."""
        self._sequence += 1
        return self.message(self._sequence, **more)

    def message(self, sequence, **more):
        """A plan for slam alone."""
        return a_message(a_target(SLAM, 0.5, weight=0.5), sequence=sequence, **more)

    def repeat(self, *plan, **more):
        """The operator says the same again."""
        self._sequence -= 1
        return self.plan(*plan, **more)

    @property
    def journal(self):
        return self._state / "agent.journal"

    def kubelet(self, group, limit):
        """The kubelet writes a limit and the watch reports it."""
        self.tree.set(group, limit)
        self.agent.on_other_write(self.tree.limit_file(group), monotonic())

    def groups(self):
        """Slam's container, its pod, and the class of both pods."""
        return [self.slam, self.slam.parent, self.slam.parent.parent]

    def everything(self):
        return [self.tree.weight(group) for group in self.groups()], self.limits()

    def foreign(self, everything):
        """Somebody else writes all of that."""
        weights, limits = everything
        for group, weight in zip(self.groups(), weights, strict=True):
            self.tree.set_weight(group, weight)
        for group, limit in zip((self.slam, self.speech), limits, strict=True):
            self.tree.set(group, limit)

    def wait(self, seconds):
        self.time.advance_by(timedelta(seconds=seconds).total_seconds())

    def weights(self):
        return self.tree.weight(self.slam), self.tree.weight(self.speech)

    def limits(self):
        return self.tree.limit(self.slam), self.tree.limit(self.speech)

    def expected(self, *cores):
        return tuple(of_container(amount, self.tree.version) for amount in cores)


ACTIVE, ASLEEP = (1.5, 0.5), (0, 0.01)


def refuse(*_):
    raise OSError(errno.EROFS, "read-only")
