"""Rendering the chart with the real helm."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
import yaml

from tests.node import build
from tests.node.layout import CACHE

CHART = Path(__file__).parents[2] / "charts" / "contextpolicy"
HOOK = "helm.sh/hook"


@pytest.fixture(scope="session")
def helm():
    """Run helm; the result is that of subprocess.run."""
    program = next(one for one in build.PROGRAMS if one.name == "helm")
    built = CACHE / "bin" / f"helm-{build.program_key(program)}" / "helm"
    binary = built if built.exists() else shutil.which("helm")
    if binary is None:
        pytest.fail("helm is not on the PATH and was not built yet: run `make cluster`, which builds it", pytrace=False)

    def run(*arguments):
        return subprocess.run([binary, *arguments], capture_output=True, text=True, timeout=60, check=False)

    return run


@pytest.fixture(scope="session")
def render(helm):
    """All objects of the chart under the given values, by kind and name: rendered once, read again by each test."""

    @cache
    def rendered(*settings):
        done = helm("template", "contextpolicy", str(CHART), "--namespace", "contextpolicy-system", *set_all(settings))
        assert done.returncode == 0, done.stderr
        return done.stdout

    def objects(*settings):
        documents = [document for document in yaml.load_all(rendered(*settings), yaml.CSafeLoader) if document]
        return {(document["kind"], document["metadata"]["name"]): document for document in documents}

    return objects


@pytest.fixture(scope="session")
def refusal(helm):
    """What helm says to values that the chart refuses."""

    def message(*settings):
        done = helm("template", "contextpolicy", str(CHART), *set_all(settings))
        assert done.returncode != 0, done.stdout
        return done.stderr

    return message


def hooks(rendered, event):
    """All that exists only while helm tests or uninstalls the release, in the order of creation."""
    found = [item for item in rendered.values() if item["metadata"].get("annotations", {}).get(HOOK) == event]
    return sorted(found, key=lambda item: int(item["metadata"]["annotations"][f"{HOOK}-weight"]))


def set_all(settings):
    """`name=value` as helm reads it; `name:=json` takes JSON."""
    return [
        part
        for setting in settings
        for part in (("--set-json", setting.replace(":=", "=", 1)) if ":=" in setting else ("--set", setting))
    ]
