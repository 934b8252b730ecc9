"""Where a machine's CPU went: nothing counts twice, and nothing is left over that was not used."""

from __future__ import annotations

from timelines.experiments.cpu_account import Account, machine_seconds


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_under_version_1_the_root_has_every_thread_to_the_nanosecond(tmp_path):
    write(tmp_path / "cpuacct" / "cpuacct.usage", "12000000005\n")
    assert machine_seconds(tmp_path) == 12.000000005


def test_under_version_2_the_groups_below_the_root_are_exact_and_the_root_counts_ticks(tmp_path):
    write(tmp_path / "cpu.stat", "usage_usec 9000000\n")
    write(tmp_path / "kubepods.slice" / "cpu.stat", "usage_usec 1500000\nuser_usec 1\n")
    write(tmp_path / "system.slice" / "cpu.stat", "usage_usec 250000\n")
    assert machine_seconds(tmp_path) == 1.75


class Kernel:
    """Counters that move on at every look, at those of the parts no faster than at the whole's."""

    def __init__(self):
        self.looks = 0

    def whole(self):
        self.looks += 1
        return 10.0 * self.looks

    def part(self):
        self.looks += 1
        return 5.0 * self.looks


def test_the_whole_is_looked_at_first_and_last_so_that_no_part_has_more():
    kernel = Kernel()
    with Account(kernel.whole, {"slam": kernel.part}) as account:
        pass
    assert account.spent == {"machine": 30.0, "slam": 5.0}  # looks 1 and 4, 2 and 3
