"""`contextpolicy agent-supervisor`: watches over the node agent."""

from __future__ import annotations

import logging
import os
import sys
import time
from typing import TYPE_CHECKING

from contextpolicy.commands.termination import stop_on_signals

if TYPE_CHECKING:
    import argparse

    from contextpolicy.agent.agent_settings import AgentSettings
    from contextpolicy.agent.state_directory import StateDirectory

log = logging.getLogger(__name__)

SHOWN = 3.0
"""Seconds for which a router is sought, and for which the token is shown: the operator asks it in vain meanwhile."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "agent-supervisor",
        help="undo what a killed node agent left behind",
        description="Until SIGTERM: wait until the node agent dies, and undo what it left behind unless another agent "
        "starts within the grace period. Settings come from the environment, like the agent's: CGROUP_ROOT, "
        "STATE_DIRECTORY, LOG_FORMAT, LOG_LEVEL; with NODE_NAME, ZENOH_CONNECT and ZENOH_CREDENTIALS, the supervisor "
        "notifies the operator of what it undid.",
    )
    parser.add_argument(
        "--grace",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="how long to wait for another agent after one has died (default: %(default)s)",
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=20.0,
        metavar="SECONDS",
        help="how long to wait for the agent to end after SIGTERM (default: %(default)s)",
    )
    parser.add_argument("--undo", action="store_true", help="undo now, unless an agent is running, and exit")
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
    own = _OwnProcess(undoing)
    supervisor = AgentSupervisor(state, own, grace=arguments.grace, patience=arguments.patience)
    WriteWatch(supervisor).add(state.lock)
    stop_on_signals(supervisor.stop)
    log.info("watching the agent")
    return supervisor.run()


class _OwnProcess:
    """Undoes in a process of its own, whose memory the supervisor does not keep."""

    def __init__(self, command: list[str]) -> None:
        self._command = command

    def undo(self) -> bool:
        process = os.posix_spawn(self._command[0], self._command, os.environ)
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0


def _undo(settings: AgentSettings, state: StateDirectory) -> bool:
    if not state.take_now():
        log.info("an agent is running: nothing to undo")
        return True
    from contextpolicy.agent.leftovers import undo

    complete = undo(settings)
    if settings.node:
        _announce(settings)
    return complete and not state.anything_left


def _announce(settings: AgentSettings) -> None:
    """Announce an agent that comes and goes: the operator then makes the kubelet write the API's limits once more.

    The death of a frozen agent would go unnoticed, and what it wrote may be undone long after the takeover.
    """
    import zenoh

    from contextpolicy.bus.decision_bus import agent_key
    from contextpolicy.bus.session import open_visitor, reason

    try:
        session = open_visitor(settings.connect, patience=SHOWN, credentials=settings.credentials)
    except zenoh.ZError as error:
        log.warning("could not report to the operator what was undone: %s", reason(error))
        return
    token = session.liveliness().declare_token(agent_key(settings.node))
    time.sleep(SHOWN)
    token.undeclare()
    session.close()
