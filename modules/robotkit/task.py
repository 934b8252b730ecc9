"""The loop of a module: take a sample, process it, publish the result; obey the policy; end on SIGTERM."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import yaml

from modules.robotkit.inputs import Input, Received
from modules.robotkit.message import MessageError
from modules.robotkit.outputs import Output, Timing
from modules.robotkit.plan import PLAN_KEY, Decision, PlanListener
from modules.robotkit.session import endpoints, open_session

if TYPE_CHECKING:
    from pathlib import Path

    import zenoh

Process: TypeAlias = Callable[[Received], Mapping[str, object] | None]
Adapt: TypeAlias = Callable[[Decision], None]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Task:
    """A module's place on the bus; `depth` is how many samples may wait."""

    name: str
    input: str
    output: str
    depth: int


def load_task(path: Path) -> Task:
    """Read the module.yaml beside a module's code."""
    module = yaml.safe_load(path.read_text(encoding="utf-8"))
    return Task(module["name"], module["input"]["key"], module["output"]["key"], module["input"]["depth"])


def main(task: Task, process: Process, adapt: Adapt = lambda _: None) -> None:
    """Run a module as a program, configured by its environment, until SIGTERM or SIGINT."""
    logging.basicConfig(level=logging.INFO, format=f"%(asctime)s {task.name}: %(message)s")
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    with open_session(endpoints(os.environ), stop) as session:
        if session is not None:
            policy_task = os.environ.get("POLICY_TASK", task.name)
            plan_key = os.environ.get("PLAN_KEY", PLAN_KEY)
            Runner(session, task, process, adapt).run(stop, policy_task=policy_task, plan_key=plan_key)


class Runner:
    """One task on one session. `adapt` hears of each decision before the input is paused or resumed."""

    def __init__(self, session: zenoh.Session, task: Task, process: Process, adapt: Adapt) -> None:
        self._session = session
        self._task = task
        self._process = process
        self._adapt = adapt
        self._input = Input(session, task.input, depth=task.depth)
        self._output = Output(session, task.output)

    def run(self, stop: threading.Event, *, policy_task: str, plan_key: str = PLAN_KEY) -> None:
        """Work until `stop` is set, whoever sets it."""
        with ThreadPoolExecutor(1, thread_name_prefix=self._task.name) as pool:
            token = self._session.liveliness().declare_token(f"robot/{self._task.name}/alive")
            self._input.resume()
            listener = PlanListener(self._session, policy_task, self._decide, key=plan_key)
            work = pool.submit(self._work)
            work.add_done_callback(lambda _: stop.set())
            _LOG.info("takes %s, gives %s", self._task.input, self._task.output)
            stop.wait()
            self._input.close()
            listener.close()
            token.undeclare()
        work.result()  # a failure ends the module loudly

    def _decide(self, decision: Decision) -> None:
        _LOG.info("%s", decision)
        self._adapt(decision)
        if decision.suspended:
            self._input.pause()
        else:
            self._input.resume()

    def _work(self) -> None:
        while (received := self._input.take()) is not None:
            started = time.time_ns()
            try:
                result = self._process(received)
            except MessageError as error:
                _LOG.warning("a sample was dropped: %s", error)
                continue
            if result is not None:
                self._output.publish(result, self._timing(received, started))

    def _timing(self, received: Received, started: int) -> Timing:
        finished = time.time_ns()
        return Timing(received.stamp, received.received, started, finished, self._input.dropped)
