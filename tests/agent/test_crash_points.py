"""The agent is killed at each of its writes, to a cgroup or its journal: what the next one makes of it."""

from __future__ import annotations

import itertools
import os
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from time import monotonic

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.agent import capabilities
from contextpolicy.agent.inotify import WriteWatch
from contextpolicy.agent.leftovers import undo
from tests.agent.builders import POLICY, SLAM, SPEECH, Tree, a_message, a_target, agent_settings, an_agent

GRACE = 10.0
BEFORE, DURING, AFTER = "before", "during", "after"
WRITES = {"CFS": 13, "CFS agreed": 18, "Realtime": 32}
"""What each story costs; in one of them the API agrees to each plan."""
POINTS = [
    (story, write, moment)
    for story, writes in WRITES.items()
    for write, moment in itertools.product(range(writes), (BEFORE, DURING, AFTER))
]
SHARES = ({"slam": 0.8, "speech": 0.1}, {"slam": 0.2, "speech": 0.6})
"""Of one core, or under Realtime of each of two."""


class Killed(BaseException):
    """SIGKILL."""


class Fuse:
    """Kills at one write: before it, in the middle of what it writes, or after it."""

    def __init__(self, monkeypatch):
        self.left, self.moment, self.writes = None, BEFORE, 0
        for owner, name in ((os, "pwrite"), (os, "write"), (os, "ftruncate"), (Path, "write_text"), (Path, "replace")):
            monkeypatch.setattr(owner, name, self._fused(getattr(owner, name)))

    def _fused(self, call):
        def fused(target, *arguments):
            self.writes += 1
            if self.left is None:
                return call(target, *arguments)
            self.left -= 1
            if self.left >= 0:
                return call(target, *arguments)
            self.left = None
            self._burn(call, target, arguments)
            raise Killed

        return fused

    def _burn(self, call, target, arguments):
        """Only a line of the journal can be cut short: the kernel takes a cgroup's text whole or not at all."""
        if self.moment == AFTER:
            call(target, *arguments)
        if self.moment == DURING and call.__name__ == "write":
            call(target, arguments[0][: len(arguments[0]) // 2])


class Story:
    """Two plans, then the policy is deleted; `after` counts the plans that some agent heard of."""

    def __init__(self, tmp_path, name, watch):
        self._scheduler, _, self._agreed = name.partition(" ")
        self._state, self._watch = tmp_path / "state", watch
        self.tree = Tree(tmp_path / "cgroup")
        self.groups = {"slam": self.tree.container(SLAM), "speech": self.tree.container(SPEECH)}
        self.before = self.seen()
        self.heard = 0
        self.start()

    def start(self):
        self.time = TestScheduler()
        self.agent = an_agent(self.tree, self._state, self.time, self._watch, grace=GRACE)
        self.agent.start()

    def tell(self):
        """The newest plan, as a source tells it to whoever asks; with a second sequence for the agent after it."""
        self.agent.find_source(POLICY)
        realtime = self._scheduler == "Realtime"
        shares = {name: share * (2 if realtime else 1) for name, share in SHARES[self.heard - 1].items()}
        targets = [a_target({"slam": SLAM, "speech": SPEECH}[name], c, task=name) for name, c in shares.items()]
        suspended = ("speech",) if realtime and self.heard == 1 else ()
        capacity = 1.9 if realtime else 1.0
        message = a_message(
            *targets, sequence=self.heard, capacity=capacity, suspended=suspended, scheduler=self._scheduler
        )
        self.agent.hear(POLICY, message)

    def run(self):
        for self.heard in range(1, len(SHARES) + 1):
            self.tell()
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
        names = ("cpu.cfs_quota_us", "cpu.rt_runtime_us", "cpu.rt_period_us")
        tops = self.groups.values() if self._agreed else [self.tree.layout.top]
        files = [path for top in tops for name in names for path in top.rglob(name)]
        return {path: path.read_text().partition("\n")[0] for path in files}

    def obeyed(self):
        read = self.tree.budget if self._scheduler == "Realtime" else self.tree.limit
        return {name: read(group) for name, group in self.groups.items()}

    def undo(self):
        """As the supervisor, after its grace period."""
        undo(agent_settings(self.tree.mount, self._state))

    def wait(self):
        self.time.advance_by(timedelta(seconds=2 * GRACE))


@pytest.fixture(autouse=True)
def _able(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)


@pytest.fixture(scope="module")
def watch():
    """Watches in vain: nobody else writes."""
    return WriteWatch(lambda *_: None)


@pytest.fixture
def tell_story(tmp_path, watch):
    return lambda name: Story(tmp_path, name, watch)


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
    fuse.writes = 0
    story.run()
    assert fuse.writes == WRITES[scheduler]
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_killed_at_a_write_and_nobody_plans_any_more(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    story.start()
    story.wait()
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_killed_at_a_write_the_next_agent_ends_where_the_plan_wants_and_can_undo_it(
    tell_story, fuse, scheduler, write, moment
):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    story.start()
    story.tell()
    story.wait()
    assert story.obeyed() == {name: round(share * 1000) for name, share in SHARES[story.heard - 1].items()}
    story.agent.lose_source(POLICY)
    story.agent.hear(POLICY, None)
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_killed_at_a_write_and_again_at_the_next_ones_start(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    fuse.left, fuse.moment = write % 5, moment
    try:
        story.start()
        story.tell()
    except Killed:
        pass
    fuse.left = None
    story.start()
    story.wait()
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_killed_at_a_write_and_the_supervisor_undoes_it(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    story.undo()
    assert story.seen() == story.before


@pytest.mark.parametrize(("scheduler", "write", "moment"), POINTS)
def test_killed_at_a_write_and_again_while_the_supervisor_undoes(tell_story, fuse, scheduler, write, moment):
    story = tell_story(scheduler)
    kill(story, fuse, write, moment)
    fuse.left, fuse.moment = write % 5, moment
    with suppress(Killed):
        story.undo()
    fuse.left = None
    story.undo()
    assert story.seen() == story.before
