"""The machine's command line, its bounds, and what is said of how it ended."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest

from tests.node import build
from tests.node.errors import ClusterError
from tests.vm import __main__ as command_line
from tests.vm import machine
from tests.vm.guest import FILES, STAGES, TESTS, stages
from tests.vm.places import INSIDE_LOGS


def a_machine(script):
    return [sys.executable, "-c", script]


def test_console_output_is_complete_after_power_off(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(machine, "LOOK", 0.01)
    caplog.set_level("INFO")
    machine.run(a_machine("print('the last words')"), tmp_path / "console.log", timeout=60)
    assert "the last words" in caplog.text


def test_a_machine_that_stays_on_times_out(tmp_path):
    with pytest.raises(ClusterError, match="still on after 0 s"):
        machine.run(a_machine("import threading; threading.Event().wait()"), tmp_path / "console.log", timeout=0)


def test_a_machine_is_killed_when_its_command_is_terminated(tmp_path, monkeypatch):
    before, started = signal.getsignal(signal.SIGTERM), []
    monkeypatch.setattr(build, "install_packages", lambda _: None)
    monkeypatch.setattr(command_line, "held", lambda _: contextlib.nullcontext())
    monkeypatch.setattr(machine, "_show", lambda _: os.kill(os.getpid(), signal.SIGTERM))
    popen = subprocess.Popen

    def start(*arguments, **more):
        started.append(popen(*arguments, **more))
        return started[0]

    monkeypatch.setattr(subprocess, "Popen", start)
    waits = a_machine("import threading; threading.Event().wait()")
    monkeypatch.setattr(command_line, "_run", lambda _: machine.run(waits, tmp_path / "console.log", timeout=60))
    try:
        with pytest.raises(SystemExit):
            command_line.main([])
    finally:
        signal.signal(signal.SIGTERM, before)
    assert started[0].wait(60) == -signal.SIGKILL


def test_a_machine_that_does_not_start_says_why(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "LOOK", 0.01)
    with pytest.raises(ClusterError, match=r"exit 3.*\nno such disk"):
        machine.run(a_machine("import sys; print('no such disk'); sys.exit(3)"), tmp_path / "console.log", timeout=60)


@pytest.fixture
def logs(tmp_path, monkeypatch):
    monkeypatch.setattr(command_line, "LOGS", tmp_path)
    folder = tmp_path / INSIDE_LOGS.name
    folder.mkdir()
    return folder


def test_all_stages_must_have_run_and_passed(logs):
    for stage in STAGES:
        (logs / stage).write_text("0")
    assert command_line._verdict(STAGES) == ""


def test_a_stage_that_failed_or_never_ran_is_named(logs):
    (logs / "running").write_text("1")
    assert "running: exit 1" in command_line._verdict(STAGES)
    assert "rebooted: not run" in command_line._verdict(STAGES)


def test_everything_runs_when_nothing_is_chosen():
    assert stages([]) == {stage: list(files) for stage, files in STAGES.items()}


def test_a_stage_without_chosen_tests_is_skipped(logs):
    chosen = ["test_running.py::test_weights_move_too_and_are_restored"]
    assert stages(chosen) == {"running": chosen}
    (logs / "running").write_text("0")
    assert command_line._verdict(stages(chosen)) == ""


def test_all_test_files_can_be_chosen():
    assert sorted(FILES) == sorted(file.name for file in TESTS.glob("test_*.py"))


def test_an_unknown_file_is_refused_with_the_known_ones(capsys):
    with pytest.raises(SystemExit):
        command_line.parser().parse_args(["test_runing.py"])
    assert f"test_runing.py: its file is none of {', '.join(FILES)}" in capsys.readouterr().err
