"""`contextpolicy agent-supervisor`: watches over the node agent."""

from __future__ import annotations

import logging
import os
import sys
from typing import TYPE_CHECKING

from contextpolicy.commands.termination import stop_on_signals

if TYPE_CHECKING:
    import argparse

    from contextpolicy.agent.agent_settings import AgentSettings
    from contextpolicy.agent.state_directory import StateDirectory

log = logging.getLogger(__name__)


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "agent-supervisor",
        help="undo what a killed node agent left",
        description="Wait for the node agent's death, give the next one the grace period to come, and undo what the "
        "dead one left if none comes; until SIGTERM. Settings come from the environment, as the agent's: CGROUP_ROOT, "
        "STATE_DIRECTORY, LOG_FORMAT, LOG_LEVEL.",
    )
    parser.add_argument(
        "--grace",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="how long after a killed agent another may come (default: %(default)s)",
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=20.0,
        metavar="SECONDS",
        help="how long to wait for the agent's end at SIGTERM (default: %(default)s)",
    )
    parser.add_argument("--undo", action="store_true", help="undo now, unless an agent lives, and exit")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Exit code 1 when something could not be undone: the kubelet starts the supervisor again, which tries again."""
    from contextpolicy.agent import agent_settings as settings
    from contextpolicy.agent.state_directory import StateDirectory
    from contextpolicy.telemetry import logs

    own = settings.read_for_supervisor(os.environ, grace=arguments.grace)
    logs.configure(own.log_format, own.log_level)
    state = StateDirectory(own.state)
    done = _undo(own, state) if arguments.undo else _supervise(state, arguments)
    return 0 if done else 1


def _supervise(state: StateDirectory, arguments: argparse.Namespace) -> bool:
    from contextpolicy.agent.agent_supervisor import AgentSupervisor
    from contextpolicy.agent.inotify import WriteWatch

    undoing = [sys.executable, "-m", "contextpolicy", "agent-supervisor", "--undo", f"--grace={arguments.grace}"]
    supervisor = AgentSupervisor(state, lambda: _succeeds(undoing), grace=arguments.grace, patience=arguments.patience)
    WriteWatch(lambda *_: supervisor.come()).add(state.lock)
    stop_on_signals(supervisor.stop)
    log.info("watching over the agent")
    return supervisor.run()


def _succeeds(command: list[str]) -> bool:
    """Run it in a process of its own, whose memory the supervisor does not keep."""
    process = os.posix_spawn(command[0], command, os.environ)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0


def _undo(settings: AgentSettings, state: StateDirectory) -> bool:
    if not state.take_now():
        log.info("an agent lives: nothing to undo")
        return True
    from contextpolicy.agent.leftovers import undo

    undo(settings)
    return not state.anything_left
