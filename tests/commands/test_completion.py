from __future__ import annotations

import shutil
import subprocess

import pytest

from contextpolicy import cli
from contextpolicy.commands import completion

PARSER = cli.build_parser("contextpolicy")


def offered(*words):
    return completion.candidates(PARSER, words, lambda command, _: ["delivery"] if command == "pause" else [])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("exp",), ["explain"]),
        (("pause", ""), ["delivery"]),
        (("pause", "x"), []),
        (("pause", "-n", "lab", "del"), ["delivery"]),
        (("completion", "b"), ["bash"]),
        (("status", "-o", ""), ["text", "json", "yaml"]),
        (("status", "-o", "js"), ["json"]),
        (("force", "--f"), ["--for"]),
        (("status", "--namespace", ""), []),
        (("nonsense",), []),
    ],
)
def test_what_tab_offers(words, expected):
    assert offered(*words) == expected


def test_every_command_is_offered():
    assert set(offered("")) >= {
        *("status", "explain", "why-not", "force", "pause", "resume", "dry-run", "top", "doctor", "record"),
        *("promote", "shadow", "adopt"),
    }


def test_without_a_cluster_nothing_breaks(monkeypatch, capsys):
    monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", "/nowhere")
    assert cli.main(["__complete", "pause", ""]) == 0
    assert capsys.readouterr().out.strip() == ""


def test_kubectl_is_told_not_to_offer_files(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["kubectl_complete-ctxp", "wh"])
    assert cli.complete() == 0
    assert capsys.readouterr().out == "why-not\n:4\n"


def test_bash_accepts_its_script_and_completes_with_it(tmp_path, capsys):
    assert cli.main(["completion", "bash"]) == 0
    program = tmp_path / "contextpolicy"
    program.write_text('#!/bin/sh\n[ "$1" = __complete ] && printf "explain\\nexport\\n"\n')
    program.chmod(0o755)
    ask = "COMP_WORDS=(contextpolicy ex) COMP_CWORD=1; _contextpolicy; echo ${COMPREPLY[@]}"
    script = f"PATH={tmp_path}:$PATH\n{capsys.readouterr().out}\n{ask}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=30, check=False)
    assert (done.stdout, done.stderr) == ("explain export\n", "")


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_accepts_its_script(capsys):
    assert cli.main(["completion", "zsh"]) == 0
    done = subprocess.run(
        ["zsh", "-n", "/dev/stdin"], input=capsys.readouterr().out, text=True, timeout=30, check=False
    )
    assert done.returncode == 0
