"""The agent is killed at each of its writes, to a cgroup or its journal: what the next one makes of it."""

from __future__ import annotations

import os
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from time import monotonic

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.agent import capabilities
from contextpolicy.agent.drains import DRAIN
from contextpolicy.agent.leftovers import undo
from contextpolicy.agent.weight_units import LEAST, of_container
from tests.agent.builders import POLICY, SLAM, SPEECH, Tree, a_message, a_target, agent_settings, an_agent

GRACE = 10.0
BEFORE, DURING, AFTER = "before", "during", "after"
WRITES = {"CFS": (13, 1), "CFS agreed": (18, 7), "Realtime": (32, 6), "Weight": (23, 4)}
"""What each story costs, and how many of it are lines of the journal.

In one of them the API agrees to each plan, in one the first plan suspends speech.
"""


def points(writes, lines):
    """Every state that a killed agent can leave: what is so after one write is so before the next."""
    return [
        *((write, BEFORE) for write in range(writes)),
        *((line, DURING) for line in range(lines)),
        (writes - 1, AFTER),
    ]


POINTS = [(story, *point) for story, cost in WRITES.items() for point in points(*cost)]
SHARES = ({"slam": 0.8, "speech": 0.1}, {"slam": 0.2, "speech": 0.6})
"""Of one core, or under Realtime of each of two."""


class Killed(BaseException):
    """SIGKILL."""


class Fuse:
    """Kills at one write: before it, after it, or in the middle of a line of the journal, which `left` counts then.

    Only that can be cut short: the kernel takes a cgroup's text whole or not at all.
    """

    def __init__(self, monkeypatch):
        self.left, self.moment, self.writes, self.lines = None, BEFORE, 0, 0
        for owner, name in ((os, "pwrite"), (os, "write"), (os, "ftruncate"), (Path, "replace")):
            monkeypatch.setattr(owner, name, self._fused(getattr(owner, name)))

    def _fused(self, call):
        is_line = call.__name__ == "write"

        def fused(target, *arguments):
            self.writes, self.lines = self.writes + 1, self.lines + is_line
            if self.left is None or (self.moment == DURING and not is_line):
                return call(target, *arguments)
            self.left -= 1
            if self.left >= 0:
                return call(target, *arguments)
            self.left = None
            self._burn(call, target, arguments)
            raise Killed

        return fused

    def _burn(self, call, target, arguments):
        if self.moment == AFTER:
            call(target, *arguments)
        elif self.moment == DURING:
            call(target, arguments[0][: len(arguments[0]) // 2])


class Story:
    """Two plans, then the policy is deleted; `after` counts the plans that some agent heard of."""

    def __init__(self, tmp_path, name):
        self._scheduler, _, self._agreed = name.partition(" ")
        self._state = tmp_path / "state"
        self.tree = Tree(tmp_path / "cgroup")
        self.groups = {"slam": self.tree.container(SLAM), "speech": self.tree.container(SPEECH)}
        self.before = self.seen()
        self.heard = 0
        self.start()

    def start(self):
        self.time = TestScheduler()
        self.agent = an_agent(self.tree, self._state, self.time, grace=GRACE)
        self.agent.start()

    def publish(self):
        """The newest plan, as a source answers a query; with a second sequence for the agent after it."""
        self.agent.find_source(POLICY)
        if self._scheduler == "Weight":
            self.weigh()
            return
        realtime = self._scheduler == "Realtime"
        shares = {name: share * (2 if realtime else 1) for name, share in SHARES[self.heard - 1].items()}
        targets = [a_target({"slam": SLAM, "speech": SPEECH}[name], c, task=name) for name, c in shares.items()]
        suspended = ("speech",) if realtime and self.heard == 1 else ()
        capacity = 1.9 if realtime else 1.0
        message = a_message(
            *targets, sequence=self.heard, capacity=capacity, suspended=suspended, scheduler=self._scheduler
        )
        self.agent.hear(POLICY, message)

    def weigh(self):
        """Weights at once; a suspended task has its quota once the input that it is at is done."""
        suspended = ("speech",) if self.heard == 1 else ()
        targets = [
            a_target(
                identity,
                SHARES[self.heard - 1][name],
                task=name,
                weight=0.0 if name in suspended else SHARES[self.heard - 1][name],
                quota=0.01 if name in suspended else 0.5,
            )
            for name, identity in (("slam", SLAM), ("speech", SPEECH))
        ]
        self.agent.hear(POLICY, a_message(*targets, sequence=self.heard, suspended=suspended))
        self.time.advance_by(timedelta(seconds=2 * DRAIN))

    def run(self):
        for self.heard in range(1, len(SHARES) + 1):
            self.publish()
            if self._agreed:
                self.agree()
        self.agent.lose_source(POLICY)
        self.agent.hear(POLICY, None)

    def agree(self):
        """The kubelet writes what the API has by now: a pod that rises before its container, one that falls after."""
        for name, share in SHARES[self.heard - 1].items():
            files = [self.tree.limit_file(group) for group in (self.groups[name].parent, self.groups[name])]
            for file in files if share > 0.5 else reversed(files):
                with file.open("w") as text:
                    text.write(f"{round(share * 100_000)}\n")
                self.agent.on_other_write(file, monotonic())

    def seen(self):
        """Every limit, period and budget; unlike the kernel's, these files keep the end of a longer text.

        A pod keeps what the API agreed to where that is no less than its containers' sum.
        """
        names = ("cpu.cfs_quota_us", "cpu.shares", "cpu.rt_runtime_us", "cpu.rt_period_us")
        tops = self.groups.values() if self._agreed else [self.tree.layout.top]
        files = [path for top in tops for name in names for path in top.rglob(name)]
        return {path: path.read_text().partition("\n")[0] for path in files}

    def obeyed(self):
        """Whether the cgroups have what the newest plan says."""
        plan = {name: round(share * 1000) for name, share in SHARES[self.heard - 1].items()}
        if self._scheduler != "Weight":
            read = self.tree.budget if self._scheduler == "Realtime" else self.tree.limit
            return {name: read(group) for name, group in self.groups.items()} == plan
        wanted = {name: (of_container(share, 1), 500) for name, share in plan.items()}
        if self.heard == 1:
            wanted["speech"] = LEAST[1], 10
        return {name: (self.tree.weight(one), self.tree.limit(one)) for name, one in self.groups.items()} == wanted

    def undo(self):
        """As the supervisor, after its grace period."""
        undo(agent_settings(self.tree.mount, self._state))

    def wait(self):
        self.time.advance_by(timedelta(seconds=2 * GRACE))


@pytest.fixture(autouse=True)
def _able(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)


@pytest.fixture
def tell_story(tmp_path):
    return lambda name: Story(tmp_path, name)


@pytest.fixture
def fuse(monkeypatch):
    return Fuse(monkeypatch)


def kill(story, fuse, write, moment):
    """End the agent there."""
    fuse.left, fuse.moment = write, moment
    with pytest.raises(Killed):
        story.run()


@pytest.mark.parametrize("scheduler", WRITES)
def test_the_story_has_this_many_writes_and_leaves_nothing(tell_story, fuse, scheduler):
    story = tell_story(scheduler)
    fuse.writes = fuse.lines = 0
    story.run()
    assert (fuse.writes, fuse.lines) == WRITES[scheduler]
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_kill_at_any_write_is_undone_without_a_plan(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    story.start()
    story.wait()
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_restarted_agent_completes_the_plan_after_a_kill_at_any_write(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    story.start()
    story.publish()
    story.wait()
    assert story.obeyed()
    story.agent.lose_source(POLICY)
    story.agent.hear(POLICY, None)
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_second_kill_during_restart_is_undone(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    fuse.left, fuse.moment = write % 5, moment
    try:
        story.start()
        story.publish()
    except Killed:
        pass
    fuse.left = None
    story.start()
    story.wait()
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_second_kill_while_the_supervisor_undoes_is_undone(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    fuse.left, fuse.moment = write % 5, moment
    with suppress(Killed):
        story.undo()
    fuse.left = None
    story.undo()
    assert story.seen() == story.before
