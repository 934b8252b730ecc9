"""A module's main loop: take a sample, process it, publish the results; obey the policy; stop when asked to."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

from robotkit.errors import DeviceError, MessageError
from robotkit.inputs import Inputs
from robotkit.outputs import Outputs, as_results
from robotkit.plan import PLAN_KEY, PlanListener
from robotkit.producer import Producer
from robotkit.profile import Profile, Run
from robotkit.reporter import Reporter
from robotkit.run_log import RunLog
from robotkit.task import Result

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

    from robotkit.inputs import Received
    from robotkit.module import Module
    from robotkit.plan import Decision
    from robotkit.task import Task

LONGEST_RUN_S = 0.1
"""How long shutdown waits for the run in progress."""

_LOG = logging.getLogger(__name__)


class Runner:
    """Runs one task on one session."""

    def __init__(self, session: zenoh.Session, module: Module, task: Task) -> None:
        self._session = session
        self._module = module
        self._task = task
        self._stop = threading.Event()
        self._failure: BaseException | None = None
        self._runs: RunLog | None = None
        self._inputs = Inputs(session, module.inputs)
        self._outputs = Outputs(session, module.outputs)
        self._profile = Profile(module)
        self._producer = Producer(task, self._outputs, self._profile, self._guarded)

    def run(
        self, stop: threading.Event, *, policy_task: str = "", plan_key: str = PLAN_KEY, publish_runs: bool = False
    ) -> None:
        """Work until `stop` is set, then make the robot safe; raises the exception that the task failed with.

        `policy_task` is the task's name in the policy, the module's own by default. With `publish_runs` the timing of
        each sample that is done goes to `robot/<task>/runs` in lists, whether or not it led to a result.
        """
        self._stop = stop
        name = policy_task or self._module.name
        if publish_runs:
            self._runs = RunLog(self._session, name)
        token = self._session.liveliness().declare_token(f"robot/{name}/alive")
        worker = threading.Thread(target=self._guarded(self._work), name=name, daemon=True)
        reporter = Reporter(self._session, name, self._profile, self._inputs, self._runs)
        self._resume()
        worker.start()
        listener = PlanListener(self._session, name, lambda decision: self._decide(decision, reporter), key=plan_key)
        _LOG.info("runs as task %s", name)
        stop.wait()
        self._inputs.close()
        self._producer.pause()
        worker.join(LONGEST_RUN_S)
        self._task.close()
        listener.close()
        reporter.close()
        token.undeclare()
        if self._failure is not None:
            raise self._failure

    def _guarded(self, work: Callable[[], None]) -> Callable[[], None]:
        """Wrap a thread's work so that an exception stops the module and is raised by `run`."""

        def guarded() -> None:
            try:
                work()
            except BaseException as error:  # noqa: BLE001 - raised again by run()
                self._failure = error
                self._stop.set()

        return guarded

    def _decide(self, decision: Decision, reporter: Reporter) -> None:
        _LOG.info("%s", decision)
        self._task.adapt(decision)
        reporter.suspended(suspended=decision.suspended)
        if decision.suspended:
            self._inputs.pause()
            self._producer.pause()
        else:
            self._resume()

    def _resume(self) -> None:
        self._inputs.resume()
        self._producer.resume()

    def _work(self) -> None:
        while (received := self._inputs.take()) is not None:
            record = self._profile.inputs[received.input]
            started, cpu = time.time_ns(), time.process_time_ns()
            try:
                results = list(as_results(self._task.process(received), self._module.outputs))
            except MessageError as error:
                record.broken += 1
                _LOG.warning("a sample of %s was dropped: %s", received.input, error)
                continue
            except DeviceError as error:
                self._profile.failures += 1
                _LOG.warning("%s", error)
                continue
            used, finished = time.process_time_ns() - cpu, time.time_ns()
            run = Run(received.stamp, received.received, started, finished, used)
            missed = record.add(run)
            self._publish(results, received, run, missed=missed)

    def _publish(self, results: list[Result], received: Received, run: Run, *, missed: bool) -> None:
        timing = {"input": received.input, **run._asdict(), "missed": missed}
        timing["dropped"] = self._inputs.dropped[received.input]
        if self._runs is not None:
            self._runs.add(timing)
        for result in results:
            stamped = result if result.stamp is not None else Result(result.output, result.value, received.stamp)
            self._outputs.publish(stamped, timing)
