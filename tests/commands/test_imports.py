"""Router and agent run on every robot: what only other commands need would be memory that tasks lack."""

import subprocess
import sys

import pytest

from contextpolicy import cli

HEAVY = {"cel", "importlib.metadata", "kopf", "kubernetes", "msgspec", "reactivex", "urllib.request", "yaml", "zenoh"}


AGENT = ("agent.agent", "agent.agent_settings", "agent.bus_link", "agent.service", "bus.signatures")
SUPERVISOR = (
    *("agent.agent_settings", "agent.agent_supervisor", "agent.inotify", "agent.state_directory", "telemetry.logs"),
)
ROUTER = ("bus.session", "telemetry.logs")
ROUTER_SUPERVISOR = ("bus.router_supervisor",)


def loaded(code):
    """All modules that are imported once a program has run."""
    program = f"import sys; {code}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    return set(done.stdout.split())


def test_parser_imports_no_heavy_module():
    assert loaded("from contextpolicy.cli import build_parser; build_parser('x')") & HEAVY == set()


@pytest.mark.parametrize("command", ["run", "router", "agent", "agent-supervisor"])
def test_long_running_command_imports_no_other_command(command):
    found = loaded(f"from contextpolicy.cli import build_parser; build_parser('x', '{command}')")
    commands = {name.rpartition(".")[2] for name in found if name.startswith("contextpolicy.commands.")}
    assert commands & {*cli.ON_THE_CLUSTER, *cli.ON_THE_DESK, *cli.IN_THE_CLUSTER} - {"completion"} == {
        command.replace("-", "_")
    }


@pytest.mark.parametrize(
    ("parts", "needed"),
    [
        (AGENT, {"msgspec", "reactivex", "urllib.request", "zenoh"}),
        (SUPERVISOR, set()),
        (ROUTER_SUPERVISOR, set()),
        (ROUTER, {"zenoh"}),
    ],
)
def test_agent_supervisor_and_router_import_what_they_need(parts, needed):
    modules = ", ".join(f"contextpolicy.{part}" for part in parts)
    assert loaded(f"import {modules}") & HEAVY <= needed
