"""A node on which writes fail: its kernel's files and the agent's disk."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from reactivex.testing import TestScheduler

from contextpolicy.agent.control_files import REALTIME
from tests.agent.builders import (
    POLICY,
    SLAM,
    SPEECH,
    UNWATCHED,
    a_message,
    a_target,
    an_agent,
)

OTHER = "robot/other"
REASONS = {
    errno.EROFS: "Forbidden",
    errno.EACCES: "Forbidden",
    errno.EINVAL: "OutOfBounds",
    errno.EBUSY: "Busy",
    errno.ENODEV: "Gone",
    errno.EIO: "Failed",
}


class Kernel:
    """System calls on files, of which some fail."""

    def __init__(self, monkeypatch):
        self._refused: dict[tuple[str, Path], int] = {}
        for name in ("pread", "pwrite", "write"):
            monkeypatch.setattr(os, name, self._checked(name, getattr(os, name), self._of_descriptor))
        monkeypatch.setattr(os, "open", self._checked("open", os.open, Path))

    def refuse(self, call, path, error):
        self._refused[call, path] = error

    def allow(self):
        self._refused.clear()

    def _checked(self, name, call, path_of):
        def checked(target, *arguments, **more):
            error = self._refused.get((name, path_of(target))) if self._refused else None
            if error is not None:
                raise OSError(error, os.strerror(error))
            return call(target, *arguments, **more)

        return checked

    def _of_descriptor(self, descriptor):
        return Path(f"/proc/self/fd/{descriptor}").readlink()


class Disk:
    """Where the journal is. When it is full, the last line may be cut short."""

    def __init__(self, monkeypatch):
        self.full, self.room = False, 0
        for owner, name in ((os, "write"), (Path, "write_bytes")):
            monkeypatch.setattr(owner, name, self._limited(getattr(owner, name)))

    def _limited(self, write):
        def limited(target, content):
            if not self.full or not content:
                return write(target, content)
            if not self.room:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            written, self.room = write(target, content[: self.room]), 0
            return written

        return limited


class Node:
    """A node with two containers of half a core each, and the agent on it."""

    def __init__(self, tree, state, monkeypatch):
        self.tree, self._state = tree, state
        self.slam, self.speech = tree.container(SLAM), tree.container(SPEECH)
        self.slam_limit, self.slam_budget = tree.limit_file(self.slam), self.slam / REALTIME[tree.version].file
        self.kernel, self.disk = Kernel(monkeypatch), Disk(monkeypatch)
        self.agent = self.start()

    def start(self, watch=UNWATCHED):
        """An agent, or another one after it."""
        self.time = TestScheduler()
        self.agent = an_agent(self.tree, self._state, self.time, watch)
        self.agent.start()
        return self.agent

    def limits(self):
        return self.tree.limit(self.slam), self.tree.limit(self.speech)

    def budgets(self):
        return self.tree.budget(self.slam), self.tree.budget(self.speech)


def plan(agent, slam=0.9, speech=0.1, policy=POLICY, **more):
    return agent.hear(policy, a_message(a_target(SLAM, slam), a_target(SPEECH, speech, task="speech"), **more))


def failed(confirmation):
    """The reasons by the container's first letter."""
    return {identity.removeprefix("containerd://")[0]: reason for identity, reason in confirmation.failed.items()}


def realtime(agent, slam=0.5, speech=0.3, **more):
    """Parts of each of the two processors' periods."""
    return plan(agent, 2 * slam, 2 * speech, scheduler="Realtime", capacity=1.9, **more)
