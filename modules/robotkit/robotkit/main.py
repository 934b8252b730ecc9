"""Runs a module as a program: configured by its environment, stopped by SIGTERM or SIGINT within a second."""

from __future__ import annotations

import logging
import os
import sys
import threading
from typing import TYPE_CHECKING

import zenoh

from robotkit.errors import ConfigurationError
from robotkit.module import load_module
from robotkit.plan import PLAN_KEY
from robotkit.ros_check import check
from robotkit.runner import Runner
from robotkit.session import credentials, endpoints, open_session, switch
from robotkit.termination import stop_on_signals

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from robotkit.task import Task

LONGEST_END_S = 0.4
"""Seconds to shut down after a signal; then the process exits, whatever still hangs."""
SWITCH_S = 0.001
"""Seconds between thread switches. A suspended task gets 1 ms of CPU per 100 ms; with Python's default of 5 ms the
thread that ends it would wait for half a second."""


def main(module_yaml: Path, build: Callable[[], Task]) -> None:
    """Run the task that `build` makes until a signal comes; a bad configuration is one line and exit code 2."""
    logging.basicConfig(level=logging.INFO, format=f"%(asctime)s {module_yaml.parent.name}: %(message)s")
    zenoh.init_log_from_env_or("error")  # else nobody learns why frames don't go by shared memory
    sys.setswitchinterval(SWITCH_S)
    stop = stop_on_signals(_leave_soon)
    try:
        _run(module_yaml, build, stop)
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
    _leave()


def _run(module_yaml: Path, build: Callable[[], Task], stop: threading.Event) -> None:
    environment = os.environ
    module, addresses = load_module(module_yaml, environment), endpoints(environment)
    check(module)
    task = build()
    shared, runs = switch(environment, "SHARED_MEMORY"), switch(environment, "KEEP_RUNS")
    secret, adaptive = credentials(environment), switch(environment, "ADAPT", absent=True)
    with open_session(addresses, stop, shared_memory=shared, secret=secret) as session:
        if session is not None:
            policy_task, plan_key = environment.get("POLICY_TASK", ""), environment.get("PLAN_KEY", PLAN_KEY)
            runner = Runner(session, module, task, adaptive=adaptive, shared_memory=shared)
            runner.run(stop, policy_task=policy_task, plan_key=plan_key, keep_runs=runs)
            _leave()  # before the session closes: the kernel closes its connection, which the router sees at once


def _leave_soon() -> None:
    threading.Event().wait(LONGEST_END_S)
    _leave()


def _leave() -> None:
    """Exit without tearing down the interpreter: that costs CPU which a suspended task does not have."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
