from __future__ import annotations

import os
import subprocess
import sys

import pytest

from robotkit import ConfigurationError
from robotkit.other_processes import OtherProcesses, clock_of


class Pod:
    """The processes of a pod, as /proc lists them, and their CPU time."""

    def __init__(self, folder, **used):
        self.folder, self.used = folder, {}
        (folder / "cpuinfo").touch()
        self.runs(os.getpid(), 10**12)
        for pid, ns in used.items():
            self.runs(int(pid.strip("_")), ns)

    def runs(self, pid, ns):
        (self.folder / str(pid)).mkdir(exist_ok=True)
        self.used[pid] = ns

    def ends(self, pid):
        (self.folder / str(pid)).rmdir()

    def of(self, pid):
        if pid not in self.used:
            raise ProcessLookupError(pid)
        return self.used[pid]


def test_usage_of_other_processes_counts_from_the_start(tmp_path):
    pod = Pod(tmp_path, _7=500)
    others = OtherProcesses(tmp_path, pod.of)
    assert others() == 0
    pod.runs(7, 600)
    pod.runs(8, 50)
    assert others() == 150


def test_usage_of_an_ended_process_is_kept(tmp_path):
    pod = Pod(tmp_path, _7=500)
    others = OtherProcesses(tmp_path, pod.of)
    pod.runs(7, 700)
    assert others() == 200
    pod.ends(7)
    assert others() == 200
    pod.runs(7, 30)  # another one, with the same number
    assert others() == 230


def test_a_process_that_ends_while_it_is_read_is_left_out(tmp_path):
    pod = Pod(tmp_path, _7=500)
    (tmp_path / "9").mkdir()
    assert OtherProcesses(tmp_path, pod.of)() == 0


def test_missing_process_namespace_sharing_is_reported(tmp_path):
    with pytest.raises(ConfigurationError, match="shareProcessNamespace: true"):
        OtherProcesses(tmp_path, Pod(tmp_path).of)


BUSY = """
import time
while time.process_time() < 0.1: pass
print("done", flush=True)
input()
"""


def test_the_kernel_shows_the_cpu_time_of_another_process():
    with subprocess.Popen(
        [sys.executable, "-c", BUSY], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "done\n"
        others = OtherProcesses()
        assert others._used(process.pid) >= 100_000_000
        process.communicate("\n")
    assert clock_of(1) == -14
