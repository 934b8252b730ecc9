"""`contextpolicy agent`: the node agent."""

from __future__ import annotations

import argparse
import gc
import logging
import os
import threading
from typing import TYPE_CHECKING

from contextpolicy.commands.termination import stop_on_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    from contextpolicy.agent.agent_settings import AgentSettings
    from contextpolicy.streams.loop import Loop

log = logging.getLogger(__name__)

HUNG = 2.0
"""Seconds after which a loop that does not answer counts as hung."""
TURN = 20.0
"""Seconds to wait for a predecessor that ends, or for a supervisor that undoes: less than a pod has to end."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "agent",
        help="run the node agent",
        description="Receive plans on the decision bus and write this node's cgroups (weights, CPU limits, realtime "
        "budgets) at once, until SIGTERM; then undo what the API has not confirmed. Settings come from the "
        "environment: NODE_NAME, PLAN_SIGNING (the directory of the operator's certificate), ZENOH_CONNECT, "
        "ZENOH_CREDENTIALS, CGROUP_ROOT (default /sys/fs/cgroup), POD_LOGS (default /var/log/pods), "
        "STATE_DIRECTORY (default /run/contextpolicy), METRICS_PORT (also answers /healthz), LOG_FORMAT, LOG_LEVEL.",
    )
    parser.add_argument(
        "--priority",
        type=_priority,
        metavar="1..99",
        default=10,
        help="realtime priority of the tasks' threads (default: %(default)s)",
    )
    parser.add_argument(
        "--grace",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="how long a policy's plan stays in force without an operator (default: %(default)s)",
    )
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT; exit code 1 makes the kubelet restart the agent: a thread failed, or another lives.

    The lock is held until the process ends.
    """
    from contextpolicy.agent import agent_settings as settings
    from contextpolicy.agent.state_directory import StateDirectory
    from contextpolicy.telemetry import logs

    own = settings.read(os.environ, priority=arguments.priority, grace=arguments.grace)
    logs.configure(own.log_format, own.log_level)
    stop, failed = stop_on_signals(), threading.Event()

    # An agent that lost a thread would still look alive: end the process instead.
    def fail(failure: threading.ExceptHookArgs) -> None:
        threading.__excepthook__(failure)
        failed.set()
        stop.set()

    threading.excepthook = fail
    state = StateDirectory(own.state)
    if not state.begin_life(TURN):
        log.error("%s: another agent, or a supervisor that undoes, has held the lock for %g s", state.lock, TURN)
        return 1
    _run(own, stop)
    return 1 if failed.is_set() else 0


def _priority(text: str) -> int:
    if text not in map(str, range(1, 100)):
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected an integer from 1 to 99")
    return int(text)


def _run(settings: AgentSettings, stop: threading.Event) -> None:
    """Start before the bus is connected: an earlier run's changes are undone in time even if no router ever answers."""
    from contextpolicy.agent.agent import Agent
    from contextpolicy.agent.agent_metrics import CONNECTED
    from contextpolicy.agent.bus_link import AgentBus
    from contextpolicy.agent.inotify import WriteWatch
    from contextpolicy.agent.service import serve
    from contextpolicy.bus.session import open_client
    from contextpolicy.bus.signatures import Verifier
    from contextpolicy.streams.loop import Loop
    from contextpolicy.telemetry.build_info import publish_build
    from contextpolicy.telemetry.certificate_metrics import publish_expiry

    publish_build("agent")
    publish_expiry("agent", settings.credentials)
    verifier = Verifier(settings.keys)
    loop = Loop()
    agent = Agent(settings, loop, WriteWatch)
    _later(loop, agent.start)
    serve(settings.metrics_port, lambda: _later(loop, lambda: None).wait(HUNG))
    gc.freeze()  # as the operator: no collection in the middle of a plan goes through all that was imported
    session = open_client(settings.connect, stop, settings.credentials)
    if session is not None:
        CONNECTED.set_function(lambda: bool(session.info.routers_zid()))
        bus = AgentBus(session, settings.node, loop, agent, verifier)
        stop.wait()
        bus.close()
        CONNECTED.set_function(lambda: False)
    _later(loop, agent.stop).wait(timeout=5)
    if session is not None:  # not before the loop is done with it
        session.close()


def _later(loop: Loop, action: Callable[[], None]) -> threading.Event:
    """Run it on the loop; the event is set when that is done."""
    done = threading.Event()

    def run(*_: object) -> None:
        action()
        done.set()

    loop.schedule(run)
    return done
