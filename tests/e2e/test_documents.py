"""The documents' commands for kubectl, as they stand but for the names, on the real cluster."""

from __future__ import annotations

import re

import pytest

from contextpolicy.cli import main
from tests.documents.commands import ROOT, commands
from tests.e2e.cluster import run, until

NAMES = {
    r"contextpolicy-system": "e2e-system",
    r"deploy/contextpolicy": "deploy/e2e",
    r"contextpolicy-live": "e2e-live",
    r"\bdelivery-robot\b": "e2e-robot/robot",
    r"\bdelivery docking\b": "e2e-robot/robot moving",
    r"\bdelivery\b": "e2e-robot/robot",
    r" --all ": " --all --all-namespaces ",
    r"^kubectl get events": "kubectl get events --all-namespaces",
}
LOOK = re.compile(r"kubectl (get (?!secret|namespace)|logs|explain|wait|kustomize|create rolebinding)")
ASK = re.compile(r"kubectl ctxp (status|doctor|top|explain|why-not) ?")


def chosen(pattern, least):
    """The commands that can be typed as they stand, each once; between backticks those of at least so many words."""
    matching = [one for one in commands() if pattern.match(one.text)]
    found = [one.text for one in matching if one.whole or len(one.words) >= least]
    return sorted({text for text in found if "delivery-next" not in text})


def renamed(text):
    for name, own in NAMES.items():
        text = re.sub(name, own, text)
    return text


@pytest.fixture(scope="module")
def governed(robot):
    """The robot under its policy, for all commands: they only look."""
    robot.policy()
    robot.expect(slam=500, speech=500)
    yield robot
    run("kubectl", "delete", "ctxp", "--all", "-n", robot.namespace, "--timeout=60s")


@pytest.mark.parametrize("text", chosen(LOOK, 3))
def test_kubectl_commands_of_the_documents_work(governed, text):
    if "events" in text:
        governed.drive(0.5)
        until("a context is reported", lambda: bool(governed.reported("ContextEntered")))
    dry = " --dry-run=server" if " create " in text else ""
    assert run("bash", "-c", f"cd {ROOT} && {renamed(text)}{dry}")


@pytest.mark.parametrize("text", chosen(ASK, 4))
def test_our_own_commands_answer(governed, capsys, text):
    governed.drive(0.0)
    once = ["--once"] if " top" in text else []
    assert main([*renamed(text).split()[2:], *once]) in (0, 1)
    assert capsys.readouterr().out
