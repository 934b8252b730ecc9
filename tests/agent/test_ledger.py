"""What was there before survives a SIGKILL at any point."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from contextpolicy.agent import ledger as ledger_module
from contextpolicy.agent.ledger import Entry, Ledger
from contextpolicy.agent.state_directory import StateDirectory

FILE = Path("/sys/fs/cgroup/cpu/kubepods/pod1/a/cpu.cfs_quota_us")


@pytest.fixture
def disk(tmp_path):
    return tmp_path / "agent.journal"


def test_journal_survives_a_restart(disk):
    ledger = Ledger(disk)
    ledger.intend(FILE, "robot/delivery", now="50000", ours="1000", held=True, original="70000", in_owned=True)
    ledger.save()
    heir = Ledger(disk)
    heir.load()
    entry = Entry("robot/delivery", "50000", "1000", held=True, inherited=True, original="70000", in_owned=True)
    assert heir.entries == {FILE: entry}


def test_first_write_records_the_external_value(disk):
    ledger = Ledger(disk)
    ledger.intend(FILE, "robot/delivery", now="50000", ours="1000")
    ledger.intend(FILE, "robot/delivery", now="1000", ours="70000")
    entry = ledger.entries[FILE]
    assert (entry.theirs, entry.ours, entry.earlier) == ("50000", "70000", {"1000"})


def test_missing_journal_is_empty(disk):
    ledger = Ledger(disk)
    ledger.load()
    assert ledger.entries == {}


DAMAGES = [
    *("{", "[]", "5", '{"/a": 5}', '["/a"]', '["/a", ["p"]]', '["/a", 5]', "\x00\xff", "[" * 200_000),
    *('["a", null]', '["/a\\u0000b", null]', '["/\\ud800", null]', "[5, null]"),
    *(
        f'["/a", ["p", {values}]]'
        for values in (
            '"x y", "1", false, [], null, false',
            '"1", 5, false, [], null, false',
            '"1", "2", false, [], "x y", false',
            '"1", "2", false, ["5 0"], null, false',
            '"1", "2", false, 5, null, false',
        )
    ),
    *(
        f'["/a/{file}", ["p", "{amount}", "1", false, [], null, false]]'
        for file, amount in (
            ("cpu.shares", "max"),
            ("cpu.weight", "-1"),
            ("cpu.cfs_quota_us", "max 100000"),
            ("cpu.rt_period_us", "1000000 2"),
            ("cpu.cfs_period_us", "0"),
            ("cpu.max", "-1 100000"),
        )
    ),
]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_line_is_left_out_and_reported(disk, damage, caplog):
    first_life(disk)
    disk.write_text(disk.read_text() + damage)
    ledger = Ledger(disk)
    ledger.load()
    assert ledger.entries.keys() == {FILE}
    assert str(disk) in caplog.text


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_lines_alone_leave_nothing_to_undo(disk, damage):
    disk.write_text(damage)
    Ledger(disk).load()
    assert not StateDirectory(disk.parent).anything_left


def test_a_journal_that_cannot_be_rewritten_is_read(disk, monkeypatch):
    first_life(disk)
    disk.write_text(disk.read_text() + "{")
    monkeypatch.setattr(Path, "write_bytes", full)
    ledger = Ledger(disk)
    ledger.load()
    assert ledger.entries.keys() == {FILE}


def full(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


def first_life(disk):
    ledger = Ledger(disk)
    ledger.intend(FILE, "robot/delivery", now="50000", ours="1000")
    ledger.save()
    return ledger


def test_the_newest_line_counts(disk):
    ledger = first_life(disk)
    ledger.intend(FILE, "robot/delivery", now="1000", ours="70000")
    ledger.save()
    ledger.hear(FILE, "60000")
    ledger.save()
    heir = Ledger(disk)
    heir.load()
    assert (heir.entries[FILE].theirs, heir.entries[FILE].ours) == ("60000", "70000")


def test_restarted_agent_keeps_inherited_entries(disk):
    first_life(disk)
    heir, other = Ledger(disk), FILE.with_name("other")
    heir.load()
    heir.intend(other, "robot/delivery", now="1", ours="2")
    heir.save()
    third = Ledger(disk)
    third.load()
    assert third.entries.keys() == {FILE, other}


def test_the_journal_ends_with_the_last_entry(disk):
    ledger = first_life(disk)
    ledger.close(FILE)
    ledger.save()
    assert disk.read_bytes() == b""


def test_a_long_journal_is_rewritten(disk, monkeypatch):
    monkeypatch.setattr(ledger_module, "LONGEST", 1000)
    ledger = first_life(disk)
    for time in range(100):
        ledger.intend(FILE, "robot/delivery", now="", ours=str(time))
        ledger.save()
    assert len(disk.read_bytes()) < 1500
    heir = Ledger(disk)
    heir.load()
    assert (heir.entries[FILE].theirs, heir.entries[FILE].ours) == ("50000", "99")


def test_a_crash_while_rewriting_the_journal_leaves_the_last_version(disk):
    first_life(disk)
    disk.with_suffix(".new").write_text('["/half')
    heir = Ledger(disk)
    heir.load()
    assert FILE in heir.entries
