import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.node import mounts, processes, shell
from tests.node.errors import ClusterError


@pytest.fixture
def sleeper(tmp_path, monkeypatch):
    """Stand in for a component: a process that is known by its file of id and start time."""
    monkeypatch.setattr(processes, "PIDS", tmp_path)
    with subprocess.Popen(["sleep", "60"]) as process:
        (tmp_path / "sleeper").write_text(f"{process.pid} {processes.start_time(process.pid)}")
        yield process
        process.kill()


def test_another_process_with_the_same_id_is_not_the_component(sleeper, tmp_path):
    (tmp_path / "sleeper").write_text(f"{sleeper.pid} 1")
    assert processes.alive("sleeper") is None


def test_stop_counts_an_unreaped_process_as_ended(sleeper):
    processes.stop("sleeper")
    assert processes.alive("sleeper") is None
    assert processes.start_time(sleeper.pid) is None


def test_stop_of_a_stopped_component_does_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "PIDS", tmp_path)
    processes.stop("nobody")


def test_started_processes_are_found_again(sleeper):
    assert processes.alive("sleeper") == sleeper.pid
    assert processes.started() == ["sleeper"]


def test_a_failing_program_is_quoted():
    with pytest.raises(ClusterError, match="exit 3\nwhy"):
        shell.run([sys.executable, "-c", "import sys; sys.stderr.write('why'); sys.exit(3)"])


def test_a_missing_program_is_named():
    with pytest.raises(ClusterError, match="no-such-program"):
        shell.run(["no-such-program"])


def test_wait_until_returns_at_the_timeout():
    assert shell.wait_until(lambda: True, timeout=0)
    assert not shell.wait_until(lambda: False, timeout=0)


def test_tail_is_the_end_of_the_file(tmp_path):
    file = tmp_path / "log"
    file.write_text("a\nb\nc\n")
    assert shell.tail(file, lines=2) == "b\nc"


def test_long_programs_write_to_their_file(tmp_path):
    output = tmp_path / "logs" / "x.log"
    shell.run_long("saying hello", ["echo", "hello"], output=output, timeout=10, env=os.environ)
    assert output.read_text() == "hello\n"


def test_mounts_below_a_folder_are_listed_newest_first():
    table = "1 0 8:1 / / rw - ext4 x rw\n2 1 8:1 / /a rw - ext4 x rw\n3 2 8:1 / /a/b rw - ext4 x rw\n"
    table += "4 1 8:1 / /ab rw - ext4 x rw\n"
    assert mounts.below(Path("/a"), table) == ["/a/b", "/a"]
