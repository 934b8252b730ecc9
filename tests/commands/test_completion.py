from __future__ import annotations

import shutil
import subprocess
from unittest.mock import Mock

import pytest

from contextpolicy import cli
from contextpolicy.commands import completion

PARSER = cli.build_parser("contextpolicy")


def offered(*words):
    return completion.candidates(PARSER, words, lambda line: ["delivery"] if line.command == "pause" else [])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("exp",), ["explain"]),
        (("pause", ""), ["delivery"]),
        (("pause", "x"), []),
        (("pause", "-n", "lab", "del"), ["delivery"]),
        (("completion", "b"), ["bash"]),
        (("status", "-o", ""), ["table", "json", "yaml"]),
        (("status", "-o", "js"), ["json"]),
        (("status", "--output=j"), ["json"]),
        (("status", "--output", "=", "j"), ["json"]),
        (("status", "--output", "="), ["table", "json", "yaml"]),
        (("pause", "--namespace=lab", "del"), ["delivery"]),
        (("force", "--f"), ["--for"]),
        (("status", "--namespace", ""), []),
        (("nonsense",), []),
    ],
)
def test_completion_suggestions(words, expected):
    assert offered(*words) == expected


@pytest.mark.parametrize(
    "words",
    [
        ("explain", "-n", "lab", "--kubeconfig=far.yaml", "--context", "dock", "delivery", ""),
        ("explain", "delivery", "-nlab", "--kubeconfig", "far.yaml", "--context=dock", ""),
        ("explain", "-o", "json", "delivery", "--namespace", "=", "lab", "-n=lab", "--kubeconfig", "far.yaml",
         "--context", "dock", ""),
    ],
    ids=" ".join,
)  # fmt: skip
def test_names_come_from_the_cluster_given_on_the_line(words):
    names = Mock(return_value=[])
    completion.candidates(PARSER, words, names)
    [line] = names.call_args.args
    options = line.options
    assert (line.command, line.places) == ("explain", ["delivery"])
    assert (options.namespace, options.kubeconfig, options.cluster) == ("lab", "far.yaml", "dock")


def test_every_command_is_offered():
    assert set(offered("")) >= {
        *("status", "explain", "why-not", "force", "pause", "resume", "dry-run", "top", "doctor", "record"),
        *("promote", "shadow", "adopt"),
    }


def test_missing_cluster_completes_nothing(monkeypatch, capsys):
    monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", "/nowhere")
    assert cli.main(["__complete", "pause", ""]) == 0
    assert capsys.readouterr().out == "", "an empty line would be a candidate, and no file would be offered"


def test_completion_offers_no_files_to_kubectl(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["kubectl_complete-ctxp", "wh"])
    assert cli.complete() == 0
    assert capsys.readouterr().out == "why-not\n:4\n"


@pytest.mark.parametrize("words", ["ex", "status --output = j", "status --output =", "validate a[", "validate *"])
def test_bash_script_passes_the_words_to_the_program(words, tmp_path, capsys):
    assert cli.main(["completion", "bash"]) == 0
    program = tmp_path / "contextpolicy"
    program.write_text('#!/bin/sh\necho "$*"\n')
    program.chmod(0o755)
    ask = (
        f'set -f; COMP_WORDS=(contextpolicy {words}) COMP_CWORD={len(words.split())}; _contextpolicy; echo "$COMPREPLY"'
    )
    script = f"PATH={tmp_path}:$PATH\n{capsys.readouterr().out}\n{ask}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=30, check=False)
    assert (done.stdout, done.stderr) == (f"__complete {words}\n", "")


def test_zsh_script_starts_the_completion_system(capsys):
    assert cli.main(["completion", "zsh"]) == 0
    *_, start, use, first = capsys.readouterr().out.splitlines()
    assert start.startswith("(( $+functions[compdef] )) || ")
    assert use == "compdef _contextpolicy contextpolicy"
    assert first.endswith("|| _contextpolicy"), "a file of fpath is read on the first Tab, which must complete too"


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_accepts_its_script(capsys):
    assert cli.main(["completion", "zsh"]) == 0
    done = subprocess.run(
        ["zsh", "-n", "/dev/stdin"], input=capsys.readouterr().out, text=True, timeout=30, check=False
    )
    assert done.returncode == 0
