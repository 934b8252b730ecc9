"""Every command in our documents works: it is run here, or by the test that is named, or it is said why not."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from contextpolicy.cli import build_parser
from tests.documents.commands import ROOT, commands

COMMANDS = commands()
NOT_WHOLE = re.compile(r"\.\.\.|<\w+>|ROUTER|NAME| \w+/( |$)")
"""What stands for something else, or is a folder that is not here."""

SIMULATED = ROOT / "modules" / "robotkit" / "robotkit" / "simulated.py"
"""The options of every simulated device."""
LEFT_OUT = "["
"""How a line begins that stands for the rest of what is printed."""

HERE = (r"contextpolicy (skeleton modules/slam|validate config|simulate config|explain config|completion bash)",)
"""Run by this test, as they stand."""

ELSEWHERE = {
    r"kubectl (get (?!secret|namespace)|logs|explain|wait|kustomize)": "tests/e2e/test_documents.py",
    r"kubectl ctxp( (status|doctor|top|explain|why-not)|$)": "tests/e2e/test_documents.py",
    r"kubectl ctxp (record|force|dry-run|resume)": "tests/e2e/test_watching.py",
    r"kubectl ctxp credentials": "tests/e2e/test_bus_security.py",
    r"kubectl create job": "tests/e2e/test_bus_security.py",
    r"kubectl ctxp pause": "tests/commands/test_on_the_cluster.py",
    r"kubectl ctxp (shadow|promote|adopt)": "tests/e2e/test_shadow.py",
    r"kubectl port-forward": "tests/e2e/test_watching.py",
    r"kubectl apply": "tests/e2e/test_policies.py",
    r"kubectl create rolebinding": "tests/e2e/test_documents.py",
    r"kubectl delete (ctxp|-f)": "tests/e2e/conftest.py",
    r"helm (upgrade|install)": "tests/e2e/conftest.py",
    r"helm rollback": "tests/e2e/test_upgrade.py",
    r"helm test": "tests/heavy/node/test_offline.py",
    r"helm push": "tests/heavy/test_release.py",
    r"make version": "tests/charts/release/test_version.py",
    r"kubectl patch": "tests/e2e/test_foreign_writers.py",
    r"helm uninstall": "tests/e2e/test_uninstall.py",
    r"contextpolicy restore": "tests/commands/test_restore.py",
    r"contextpolicy router": "tests/commands/test_router.py",
    r"contextpolicy top": "tests/commands/test_top.py",
    r"contextpolicy explain$": "tests/commands/test_explain.py",
    r"contextpolicy graph": "tests/commands/test_graph.py",
    r"contextpolicy suggest": "tests/commands/test_suggest.py",
    r"contextpolicy skeleton modules/\*/": "tests/commands/test_skeleton.py",
    r"contextpolicy validate$": "tests/commands/test_validate.py",
    r"contextpolicy simulate (--profiles|policy\.yaml)": "tests/commands/test_simulate.py",
    r"contextpolicy (validate|simulate|explain) first\.yaml": "tests/documents/test_tutorial.py",
    r"python -m charts\.release": "tests/heavy/test_release.py",
    r"python -m timelines\.scenarios": "tests/timelines/scenarios/test_scenarios.py",
    r"python -m timelines\.replay": "tests/timelines/replay/test_player.py",
    r"python -m timelines\.recording run": "tests/timelines/recording/test_labels.py",
    r"python -m timelines\.recording\.layout ": "tests/timelines/recording/test_layout.py",
    r"python -m timelines\.recording\.live": "tests/timelines/recording/test_live.py",
    r"python -m timelines\.experiments": "tests/timelines/experiments/test_run.py",
    r"python -m modules\.slam\.evaluation": "tests/modules/slam/test_evaluation.py",
    r"python -m modules\.slam\.comparison": "tests/modules/slam/test_comparison.py",
    r"python -m modules\.speech\.evaluation": "tests/modules/speech/test_speech_commands.py",
    r"python -m modules\.speech\.training": "tests/modules/speech/test_training.py",
    r"python -m modules\.signs\.accuracy": "tests/modules/signs/test_accuracy.py",
    r"python -m modules\.imu\.accuracy": "tests/modules/imu/test_motion.py",
    r"python -m modules\.transcript\.accuracy": "tests/modules/transcript/test_accuracy.py",
    r"python -m modules\.(lidar|navigation)\.simulator": "tests/modules/navigation/test_simulator.py",
    r"python -m modules\.navigation\.guard": "tests/modules/navigation/test_guard.py",
    r"python -m tests\.oracle": "tests/oracle/test_oracle.py",
    r"python -m robotkit\.ask": "tests/modules/robotkit/test_ask.py",
    r"python -m robotkit\.profiles": "tests/modules/robotkit/test_profiles.py",
    r"python -m robotkit\.sidecar": "tests/modules/robotkit/test_sidecar.py",
    r"python (-m modules\.<name>|loudness)": "tests/modules/robotkit/test_readme.py",
}
"""By the beginning of the command, the test that runs it, or what it calls."""

NOT_HERE = {
    r"make (demo|test|e2e|unit|heavy|soak|arm64|test-all|experiments|bench\S*|cluster-down)": "it runs tests, "
    "or for minutes on a node of its own; CI runs `make test`",
    r"make setup": "every test runs on what it installed",
    r"make (crds|docs|help|simulate|pictures|release)": "a line of the Makefile over a command that is tested",
    r"(\.venv/bin/)?python -m tests\.(node|bench|fuzz|vm)": "it builds a node or a machine, measures, or needs atheris",
    r"python -m timelines\.datasets": "it renders and speaks for minutes; `make recordings` runs it before the tests",
    r"python -m modules\.signs\.training": "eight minutes of CPU; what it made is in the repository, and tested",
    r"sudo k3s ctr|buildah push": "it needs a k3s; tests.node imports the same images into its containerd",
    r"sudo config/k3s/try\.sh": "it installs k3s from the internet; shellcheck reads it",
    r"git commit": "it would change the repository that is tested",
    r"buildah bud": "tests.node builds the same images by the same Dockerfiles",
    r"pip install": "it changes the interpreter that runs the tests; `make setup` does it",
    r"kubectl config": "it would change the tester's own settings",
    r"kubectl (get (secret|namespace)|describe)": "it shows what only a failed or closed installation has",
    r"kubectl delete crd": "it would take every policy of the cluster that other tests use",
}
"""By the beginning of the command, why no test runs it as it stands."""


def ways(text):
    """How a command is tested: the rows of the tables above that it matches."""
    text = re.sub(r"^([A-Z_]+=\S+ )+", "", text)
    return [pattern for table in (HERE, ELSEWHERE, NOT_HERE) for pattern in table if re.match(pattern, text)]


def ids(command):
    return f"{command.document}: {command.text}"


def test_commands_are_found():
    assert len(COMMANDS) > 100
    assert {"README.md", "docs/how-to/rollout.md"} <= {one.document for one in COMMANDS}


def test_every_command_is_tested_in_one_way():
    assert {ids(one): ways(one.text) for one in COMMANDS if len(ways(one.text)) != 1} == {}


def test_every_row_matches_a_command():
    used = {pattern for one in COMMANDS for pattern in ways(one.text)}
    assert {*HERE, *ELSEWHERE, *NOT_HERE} - used == set()


@pytest.mark.parametrize("pattern", ELSEWHERE)
def test_named_test_mentions_the_command(pattern):
    """It speaks of a subcommand or a module that the row is for."""
    text = (ROOT / ELSEWHERE[pattern]).read_text(encoding="utf-8")
    words = [
        word for word in re.findall(r"[a-z][a-z-]{3,}", pattern) if word not in ("python", "kubectl", "contextpolicy")
    ]
    assert not words or any(re.search(rf"\b{word}", text) for word in words), words


@pytest.mark.parametrize(
    "command", [one for one in COMMANDS if re.match(r"(kubectl ctxp|contextpolicy) ", one.text)], ids=ids
)
def test_subcommand_and_options_exist(command, capsys):
    words = command.words[2 if command.words[0] == "kubectl" else 1 :]
    if command.whole and not NOT_WHOLE.search(command.text):
        build_parser("contextpolicy").parse_args(words)
    elif words:
        with pytest.raises(SystemExit) as ended:
            build_parser("contextpolicy").parse_args([words[0], "--help"])
        assert ended.value.code == 0
        reported = capsys.readouterr().out
        assert [word for word in words if word.startswith("--") and word not in reported] == []


@pytest.mark.parametrize("command", [one for one in COMMANDS if one.words[0] == "make"], ids=ids)
def test_makefile_target_exists(command):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = [word for word in command.words[1:] if "=" not in word]
    settings = [word.partition("=")[0] for word in command.words[1:] if "=" in word]
    assert [target for target in targets if not re.search(rf"^{target}:.*##", makefile, flags=re.MULTILINE)] == []
    assert [name for name in settings if f"$({name})" not in makefile] == []


@pytest.mark.parametrize("command", [one for one in COMMANDS if " -m " in one.text and "<" not in one.text], ids=ids)
def test_python_module_and_options_exist(command):
    words = command.words
    module, arguments = words[words.index("-m") + 1], words[words.index("-m") + 2 :]
    found = importlib.util.find_spec(module)
    assert found is not None
    folders = [Path(folder) for folder in found.submodule_search_locations or ()]
    sources = [path for folder in folders for path in folder.glob("*.py")] or [Path(str(found.origin)), SIMULATED]
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    own = arguments[: arguments.index("--")] if "--" in arguments else arguments
    assert [word for word in own if word.startswith("--") and f'"{word}"' not in text] == []


@pytest.mark.parametrize("command", [one for one in COMMANDS if one.words[0] == "helm" and one.whole], ids=ids)
def test_chart_and_values_exist(command):
    for name in [word for word in command.words if word.startswith("charts/")]:
        values = yaml.safe_load((ROOT / name / "values.yaml").read_text(encoding="utf-8"))
        for setting in [own for before, own in pairwise(command.words) if before == "--set"]:
            value = values
            for part in setting.partition("=")[0].split("."):
                assert part in value, setting
                value = value[part]


@pytest.fixture
def repository(tmp_path):
    """A folder in which the documents' paths lead to what they mean, and what is written is gone afterwards."""
    for name in ("config", "timelines", "modules", "charts"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "build").mkdir()
    return tmp_path


@pytest.mark.parametrize("command", [one for one in COMMANDS if any(re.match(own, one.text) for own in HERE)], ids=ids)
def test_command_prints_the_documented_output(command, repository):
    program = repository / "programs" / "contextpolicy"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m contextpolicy "$@"\n')
    program.chmod(0o755)
    paths = {"PATH": f"{program.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT / "operator")}
    environment = {**os.environ, **paths}
    shell = shutil.which("bash") or "sh"
    ran = subprocess.run(
        [shell, "-c", command.text], cwd=repository, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    whole, dots, _ = command.printed.partition(f"\n{LEFT_OUT}")
    expected, printed = whole.strip().splitlines(), ran.stdout.strip().splitlines()
    assert not expected or expected == (printed[: len(expected)] if dots else printed)
