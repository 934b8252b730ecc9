"""How the program ends, whatever happens to it and to its output: a documented exit code, one line, no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from contextpolicy import cli
from contextpolicy.commands import exit_codes

ROOT = Path(__file__).parents[2]
POLICY = str(ROOT / "config/policies/arm-and-camera.yaml")
PROGRAM = [sys.executable, "-m", "contextpolicy"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT / "operator")}
PARSER = cli.build_parser("contextpolicy")
COMMANDS = sorted(PARSER._subparsers._group_actions[0].choices)  # type: ignore[union-attr,arg-type]


def ended(words, redirection):
    command = ["sh", "-c", f'exec "$@" {redirection}', "sh", *PROGRAM, *words]
    return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=60, check=False)


PRINTING = [
    ["--help"],
    ["validate", POLICY, "--output", "json"],
    ["graph", POLICY],
    ["completion", "bash"],
    ["--version"],
]


@pytest.mark.parametrize("words", PRINTING, ids=" ".join)
@pytest.mark.parametrize(
    ("redirection", "reason"),
    [(">/dev/full", "No space left on device"), (">&-", "Bad file descriptor"), (">&- 2>&-", "")],
)
def test_unwritable_output_fails_with_one_line(words, redirection, reason):
    done = ended(words, redirection)
    said = f"contextpolicy: standard output: {reason}\n"
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith(said if reason else "")
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr


def test_closed_stderr_is_not_an_error():
    done = ended(["validate", POLICY], "2>&-")
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-"])
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["validate", "/nonexistent.yaml"], 2),
        (["validate", str(ROOT / "config/policies")], 0),
        (["simulate", str(ROOT / "config/policies/whole-robot.yaml"), str(ROOT / "timelines/exp1.json")], 0),
        (["status", "--nonsense"], 2),
    ],
    ids=["error", "summary", "notes", "usage"],
)
def test_full_stderr_does_not_change_the_exit_code(words, code, redirection):
    """Notes go there too, and a result that is complete must not count as a failure."""
    assert ended(words, redirection).returncode == code


def test_ctrl_c_ends_the_command_silently(tmp_path):
    policy = tmp_path / "policy.yaml"
    os.mkfifo(policy)
    command = [*PROGRAM, "simulate", str(policy), str(ROOT / "timelines/paper.json")]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, env=ENVIRONMENT)
    with policy.open("w"), running:  # it reads now
        running.send_signal(signal.SIGINT)
        output, errors = running.communicate(timeout=60)
    assert (running.returncode, output, errors) == (128 + signal.SIGINT, b"", b"")


LOADING = """
class Interrupting:
    def find_spec(self, name, *_):
        if name == "contextpolicy.cli":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
"""
LEAVING = "import atexit; atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))"


@pytest.mark.parametrize("moment", [LOADING, LEAVING], ids=["while it is loaded", "when it has ended"])
@pytest.mark.parametrize("ignored", [True, False])
def test_ctrl_c_while_loading_or_exiting_prints_no_traceback(moment, ignored):
    """Loading takes longer than the command, on a slow board a second."""
    handler = "signal.SIG_IGN" if ignored else "signal.default_int_handler"
    begin = f"import os, runpy, signal, sys; signal.signal(signal.SIGINT, {handler}); sys.argv[1:] = ['--version']\n"
    run = "\nrunpy.run_module('contextpolicy', run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", begin + moment + run],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0 if ignored else -signal.SIGINT, "")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_lists_exit_codes_once(command, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main([command, "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert (end.value.code, text.lower().count("exit code")) == (0, 1 + text.count("exit code 1 and a line"))
    assert exit_codes.described(command) in text


def test_exit_code_table_lists_only_commands():
    assert exit_codes.ANSWERS.keys() <= {*COMMANDS, "COMMAND"}


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_refuses_wrong_usage_with_2(command, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main([command, "--nonsense"])
    assert end.value.code == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "words",
    [["validate", POLICY, "--out", "json"], ["status", "--all"], ["--vers"], ["simulate", POLICY, "x", "--core", "4"]],
    ids=" ".join,
)
def test_an_abbreviated_option_is_refused(words):
    with pytest.raises(SystemExit) as end:
        cli.main(words)
    assert end.value.code == 2


def test_dashes_alone_do_not_make_options_alike(capsys):
    with pytest.raises(SystemExit):
        cli.main(["simulate", POLICY, POLICY, "--deadline", "slam=1s"])
    assert capsys.readouterr().err.startswith(
        "contextpolicy simulate: error: unrecognized arguments: --deadline slam=1s\n"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["stattus"],
            "contextpolicy: error: unknown command 'stattus'; did you mean status? Try 'contextpolicy --help'.",
        ),
        (["nonsense"], "contextpolicy: error: unknown command 'nonsense' Try 'contextpolicy --help'."),
        (["status", "--namespac", "robot"], "unrecognized arguments: --namespac; did you mean --namespace?"),
        (["validate", POLICY, "--out=json"], "unrecognized arguments: --out=json; did you mean --output?"),
        (
            ["validate", POLICY, "-o", "jsn"],
            "invalid choice: 'jsn', expected one of table, json, yaml; did you mean json?",
        ),
    ],
    ids=lambda part: " ".join(part) if isinstance(part, list) else "",
)
def test_wrong_usage_names_what_may_be_meant_and_fits_the_terminal(words, said, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    with pytest.raises(SystemExit) as end:
        cli.main(words)
    error = capsys.readouterr().err
    assert end.value.code == 2
    assert said in " ".join(error.split())
    assert [line for line in error.splitlines() if len(line) > 40 and " " in line.strip()] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_wrong_usage_is_one_line_and_where_to_find_help(command, capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    with pytest.raises(SystemExit):
        cli.main([command, "--nonsense", "b" * 90])
    error, hint = capsys.readouterr().err.splitlines()
    assert error.startswith(f"contextpolicy {command}: error: ")
    assert hint == f"Try 'contextpolicy {command} --help'."


@pytest.mark.parametrize("columns", [40, 60, 80, 120])
@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_the_terminal(command, columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit):
        cli.main([command, "--help"])
    text = capsys.readouterr().out
    breakable = [line for line in text.splitlines() if " " in line.strip() and not line.lstrip().startswith(CODE)]
    assert [line for line in breakable if len(line) > columns] == []


CODE = ("-o {", "- {", "- at", "contextpolicy suggest", "kubectl patch", "slam:")
"""How lines of examples begin, which can't be wrapped."""
