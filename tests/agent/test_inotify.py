"""Who else writes a file."""

from __future__ import annotations

import ctypes
import errno
import os
import queue
from typing import Any

import pytest

from contextpolicy.agent.inotify import WriteWatch
from tests.waiting import PATIENCE


class Heard(queue.Queue[Any]):
    """The files that others wrote."""

    def on_write(self, path, _):
        self.put(path)


@pytest.fixture
def heard():
    return Heard()


@pytest.fixture
def watch(heard):
    return WriteWatch(heard)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "quota"
    path.write_text("-1\n")
    return path


def test_own_writes_are_not_reported_but_others_are(watch, heard, file, tmp_path):
    own, fence = os.open(file, os.O_RDWR), tmp_path / "fence"
    fence.touch()
    watch.add(file)
    watch.add(fence)
    os.pwrite(own, b"1000\n", 0)
    fence.write_text("x")
    assert heard.get(timeout=PATIENCE) == fence
    file.write_text("2000\n")
    assert heard.get(timeout=PATIENCE) == file
    os.close(own)


def test_unwatched_file_is_not_reported(watch, heard, file, tmp_path):
    fence = tmp_path / "fence"
    fence.touch()
    watch.add(file)
    watch.add(fence)
    watch.remove(file)
    file.write_text("2000\n")
    fence.write_text("x")
    assert heard.get(timeout=PATIENCE) == fence


def test_deleted_file_does_not_end_the_watch(watch, heard, file, tmp_path):
    watch.add(file)
    file.unlink()
    watch.remove(file)
    other = tmp_path / "other"
    other.touch()
    watch.add(other)
    other.write_text("x")
    assert heard.get(timeout=PATIENCE) == other


def test_a_file_that_is_not_there_cannot_be_watched(watch, tmp_path):
    with pytest.raises(FileNotFoundError):
        watch.add(tmp_path / "no")


def test_queue_overflow_reports_every_file_as_written(watch, file, tmp_path):
    other = tmp_path / "other"
    other.touch()
    watch.add(file)
    watch.add(other)
    assert watch._written(-1) == [file, other]


class Refusing:
    """The C library whose kernel has no watch left."""

    def inotify_add_watch(self, *_):
        ctypes.set_errno(errno.ENOSPC)
        return -1


def test_exhausted_watches_name_the_sysctl_to_raise(watch, file, monkeypatch):
    monkeypatch.setattr(watch, "_libc", Refusing())
    with pytest.raises(OSError, match=r"raise fs\.inotify\.max_user_watches") as caught:
        watch.add(file)
    assert caught.value.errno == errno.ENOSPC
