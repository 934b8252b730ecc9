"""Bandwidth files: what texts mean, and the kernel's refusals in our words."""

from __future__ import annotations

import errno
import os

import pytest

from contextpolicy.agent.control_files import CFS, REALTIME, ControlFile, ControlFiles
from contextpolicy.errors import ActuationError
from tests.agent.builders import Watch

FILES = {
    "cfs v1": (CFS[1], {"cpu.cfs_quota_us": "-1\n", "cpu.cfs_period_us": "100000\n"}),
    "cfs v1, period of 20 ms": (CFS[1], {"cpu.cfs_quota_us": "-1\n", "cpu.cfs_period_us": "20000\n"}),
    "cfs v2": (CFS[2], {"cpu.max": "max 100000\n"}),
    "realtime v1": (REALTIME[1], {"cpu.rt_runtime_us": "0\n", "cpu.rt_period_us": "1000000\n"}),
    "realtime v2": (REALTIME[2], {"cpu.rt.max": "0 1000000\n"}),
}


@pytest.fixture
def make(tmp_path):
    def make(kind):
        form, files = FILES[kind]
        for name, text in files.items():
            (tmp_path / name).write_text(text)
        return ControlFile(tmp_path, form)

    return make


@pytest.mark.parametrize(
    ("kind", "amount", "text"),
    [
        ("cfs v1", 990, "99000 100000"),
        ("cfs v1", 10, "1000 100000"),
        ("cfs v1", 1, "1000 100000"),
        ("cfs v1, period of 20 ms", 500, "10000 20000"),
        ("cfs v2", 1500, "150000 100000"),
        ("realtime v1", 475, "475000"),
        ("realtime v1", 0, "0"),
        ("realtime v2", 1, "1000 1000000"),
    ],
)
def test_an_amount_is_time_per_period(make, kind, amount, text):
    assert make(kind).text(amount) == text


@pytest.mark.parametrize(
    ("kind", "text", "amount"),
    [
        ("cfs v1", "99000", 990),
        ("cfs v1", "-1 100000", None),
        ("cfs v1", "10000 20000", 500),
        ("cfs v2", "max 100000", None),
        ("cfs v2", "41700 100000", 417),
        ("realtime v1", "950000", 950),
        ("realtime v2", "1000 1000000", 1),
        ("cfs v1", "1001", 11),
    ],
)
def test_a_text_is_an_amount_rounded_up(make, kind, text, amount):
    assert make(kind).amount(text) == amount


@pytest.mark.parametrize("kind", FILES)
def test_shorter_value_overwrites_a_longer_one(make, kind):
    file = make(kind)
    for amount in (990, 10, 700):
        file.write(file.text(amount))
        assert file.read() == file.text(amount)


@pytest.mark.parametrize(
    ("kind", "name", "content"),
    [("cfs v1", "cpu.cfs_period_us", "20000\n"), ("cfs v2", "cpu.max", "max 20000\n")],
)
def test_a_period_that_others_change_is_that_of_the_next_text(make, tmp_path, kind, name, content):
    file = make(kind)
    file.read()
    (tmp_path / name).write_text(content)
    file.read()
    assert file.text(500) == "10000 20000"


def test_a_group_that_is_not_there_is_gone(tmp_path):
    with pytest.raises(ActuationError) as caught:
        ControlFile(tmp_path / "no", CFS[1])
    assert caught.value.reason == "Gone"


def test_a_group_whose_controller_is_not_enabled_is_not_gone(tmp_path):
    with pytest.raises(ActuationError, match=r"cpu.max.*controller") as caught:
        ControlFile(tmp_path, CFS[2])
    assert caught.value.reason == "NotEnabled"


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        (errno.ENODEV, "Gone"),
        (errno.EINVAL, "OutOfBounds"),
        (errno.EBUSY, "Busy"),
        (errno.EROFS, "Forbidden"),
        (errno.EIO, "Failed"),
    ],
)
def test_the_kernels_refusal_has_a_reason(make, monkeypatch, code, reason):
    def refuse(*_):
        raise OSError(code, os.strerror(code))

    file = make("cfs v1")
    monkeypatch.setattr(os, "pwrite", refuse)
    with pytest.raises(ActuationError, match="cfs_quota_us") as caught:
        file.write("1000")
    assert caught.value.reason == reason


def test_files_open_once_and_close_when_unused(tmp_path, make):
    make("cfs v1").close()
    watch = Watch()
    files = ControlFiles(CFS[1], watch)
    assert files[tmp_path] is files[tmp_path]
    files.keep([tmp_path])
    assert watch.paths == {tmp_path / "cpu.cfs_quota_us", tmp_path / "cpu.cfs_period_us"}
    files.keep([])
    assert watch.paths == set()
