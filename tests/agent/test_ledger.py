"""What was there before survives a SIGKILL at any point."""

from __future__ import annotations

from pathlib import Path

import pytest

from contextpolicy.agent.ledger import Entry, Ledger

FILE = Path("/sys/fs/cgroup/cpu/kubepods/pod1/a/cpu.cfs_quota_us")


@pytest.fixture
def disk(tmp_path):
    return tmp_path / "agent.json"


def test_another_life_knows_it_all(disk):
    ledger = Ledger(disk)
    ledger.intend(FILE, "robot/delivery", now="50000", ours="1000", held=True)
    ledger.save()
    heir = Ledger(disk)
    heir.load()
    assert heir.entries == {FILE: Entry("robot/delivery", "50000", "1000", held=True, inherited=True)}


def test_only_the_first_write_finds_theirs(disk):
    ledger = Ledger(disk)
    ledger.intend(FILE, "robot/delivery", now="50000", ours="1000")
    ledger.intend(FILE, "robot/delivery", now="1000", ours="70000")
    entry = ledger.entries[FILE]
    assert (entry.theirs, entry.ours, entry.earlier) == ("50000", "70000", {"1000"})


def test_what_is_closed_is_gone_from_disk(disk):
    ledger = Ledger(disk)
    ledger.intend(FILE, "robot/delivery", now="50000", ours="1000")
    ledger.save()
    ledger.close(FILE)
    ledger.save()
    heir = Ledger(disk)
    heir.load()
    assert heir.entries == {}


def test_the_first_life_has_no_file(disk):
    ledger = Ledger(disk)
    ledger.load()
    assert ledger.entries == {}


@pytest.mark.parametrize("damage", ["", "{", "[]", "5", '{"/a": 5}', '{"/a": ["p"]}'])
def test_a_damaged_file_is_as_none_and_is_reported(disk, damage, caplog):
    disk.write_text(damage)
    ledger = Ledger(disk)
    ledger.load()
    assert ledger.entries == {}
    assert str(disk) in caplog.text


def test_a_crash_while_saving_leaves_the_last_version(disk):
    ledger = Ledger(disk)
    ledger.intend(FILE, "robot/delivery", now="50000", ours="1000")
    ledger.save()
    disk.with_suffix(".new").write_text('{"/half')
    heir = Ledger(disk)
    heir.load()
    assert FILE in heir.entries
