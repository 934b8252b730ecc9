"""What the operator and the agent must not carry."""

import subprocess
import sys

import pytest

UNUSED = {"prompt_toolkit", "pygments", "rich", "typer"}


@pytest.mark.parametrize("module", ["contextpolicy.app.supervisor", "contextpolicy.agent.agent"])
def test_operator_and_agent_do_not_import_the_terminal_toolkit(module):
    reported = subprocess.run(
        [sys.executable, "-c", f"import sys, {module}; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    assert UNUSED.isdisjoint(reported.stdout.split())
