"""Every module looks the same: the same files, a module.yaml that says what it needs, an image that runs as nobody."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from robotkit import load_module

ROOT = Path(__file__).parents[2] / "modules"
MODULES = sorted(path.parent for path in ROOT.glob("*/module.yaml"))
FILES = {"Dockerfile", "README.md", "__main__.py", "module.yaml", "requirements.txt", "task.py"}


@pytest.fixture(params=MODULES, ids=lambda folder: folder.name)
def module(request):
    return request.param


def test_there_are_modules():
    assert {"chatbot", "signs", "slam", "speech", "transcript", "voice"} <= {folder.name for folder in MODULES}


def test_it_has_the_same_files(module):
    assert {path.name for path in module.iterdir()} >= FILES


def test_it_declares_inputs_outputs_and_needs(module):
    said = load_module(module / "module.yaml")
    assert said.name == module.name
    assert all(entry.key.startswith(("robot/", "contextpolicy/")) for entry in said.inputs.values())
    assert all(entry.key.startswith("robot/") for entry in said.outputs.values())
    assert None not in (said.needs.cores, said.needs.memory, said.needs.deadline)


def test_its_readme_documents_streams_settings_cost_and_what_a_suspension_does(module):
    said = load_module(module / "module.yaml")
    readme = (module / "README.md").read_text(encoding="utf-8")
    settings = yaml.safe_load((module / "module.yaml").read_text(encoding="utf-8")).get("environment", {})
    keys = [*(entry.key for entry in said.inputs.values()), *(entry.key for entry in said.outputs.values())]
    assert [reported for reported in (*keys, *settings) if reported not in readme] == []
    assert re.search(r"\d m?s of CPU|\dm of CPU|CPU a frame", readme)
    assert re.search(r"\d Mi?B", readme)
    assert "uspended" in readme


def test_its_readme_begins_with_purpose_and_measurements(module):
    """In its first lines; measurements on nothing but our own data are declared as such."""
    beginning = " ".join((module / "README.md").read_text(encoding="utf-8").splitlines()[:9])
    assert re.search(r"good for|demonstration", beginning, re.IGNORECASE)
    assert re.search(r"measured (only )?(on|for)", beginning, re.IGNORECASE)


def test_its_image_runs_unprivileged_and_starts_the_module(module):
    lines = (module / "Dockerfile").read_text(encoding="utf-8").splitlines()
    assert "USER 65532:65532" in lines
    assert lines[-1] == f'ENTRYPOINT ["/opt/module/bin/python", "-m", "modules.{module.name}"]'
