"""A node's cgroups in every layout, and what a killed agent leaves to the kernel."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import pytest

from tests.agent.builders import LAYOUTS, SLAM, SPEECH, Tree


@pytest.fixture(params=LAYOUTS, ids=str)
def tree(request, tmp_path):
    return Tree(tmp_path / "cgroup", *request.param)


@pytest.fixture
def slam(tree):
    return tree.container(SLAM)


@pytest.fixture
def speech(tree):
    return tree.container(SPEECH)


@pytest.fixture(autouse=True)
def _descriptors(tmp_path):
    """The kernel closes the files of a killed process; an agent that a test kills only forgets them."""
    yield
    for descriptor in list(Path("/proc/self/fd").iterdir()):
        with suppress(OSError):
            if descriptor.readlink().is_relative_to(tmp_path):
                os.close(int(descriptor.name))
