"""Router and agent run on every robot: what only other commands need would be memory that tasks lack."""

import subprocess
import sys

import pytest

HEAVY = {"cel", "importlib.metadata", "kopf", "kubernetes", "msgspec", "reactivex", "urllib.request", "yaml", "zenoh"}


@pytest.fixture(scope="module")
def loaded():
    code = "import sys; from contextpolicy.cli import build_parser; build_parser('x'); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    return set(done.stdout.split())


def test_the_command_line_alone_imports_nothing_that_is_large(loaded):
    assert loaded & HEAVY == set()
