"""A module's main loop: take a sample, process it, publish the results; obey the policy; stop when asked to."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

from robotkit.cgroup import own_usage
from robotkit.errors import ConfigurationError, DeviceError, MessageError
from robotkit.inputs import Inputs
from robotkit.outputs import CDR, Outputs, as_results
from robotkit.plan import PLAN_KEY, PlanListener
from robotkit.producer import Producer
from robotkit.profile import Profile, Run
from robotkit.quality import Quality
from robotkit.reporter import Reporter
from robotkit.ros_presence import RosPresence
from robotkit.run_log import RunLog
from robotkit.stamps import header_stamp
from robotkit.task import Result, Task

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

    from robotkit.inputs import Received
    from robotkit.module import Module
    from robotkit.plan import Decision

LONGEST_RUN_S = 0.1
"""How long shutdown waits for the run in progress."""

_LOG = logging.getLogger(__name__)


class Runner:
    """Runs one task on one session."""

    def __init__(
        self, session: zenoh.Session, module: Module, task: Task, *, shared_memory: bool, adaptive: bool = True
    ) -> None:
        """`shared_memory` is what the session was opened with."""
        self._session = session
        self._module = module
        self._task = task
        self._stop = threading.Event()
        self._failure: BaseException | None = None
        self._runs: RunLog | None = None
        self._presence: RosPresence | None = None
        self._inputs = Inputs(session, module.inputs, module.needs.deadline)
        self._outputs = Outputs(session, module.outputs, shared_memory=shared_memory)
        self._profile = Profile(module)
        can_adapt = type(task).set_quality is not Task.set_quality
        self._quality, self._set = Quality(module.needs.deadline, adaptive=adaptive and can_adapt), 1.0
        self._producer = Producer(task, self._outputs, self._profile, self._guarded)

    def run(
        self, stop: threading.Event, *, policy_task: str = "", plan_key: str = PLAN_KEY, keep_runs: bool = False
    ) -> None:
        """Work until `stop` is set, then make the robot safe; raises the exception that the task failed with.

        `policy_task` is the task's name in the policy, the module's own by default. With `keep_runs` the
        timing of each sample that is done is kept, whether or not it led to a result, for who asks on
        `robot/<task>/runs`.
        """
        self._stop = stop
        name = policy_task or self._module.name
        if keep_runs:
            self._runs = RunLog(self._session, name)
        token = self._session.liveliness().declare_token(f"robot/{name}/alive")
        self._presence = RosPresence(self._session, name, self._module)
        worker = threading.Thread(target=self._guarded(self._work), name=name, daemon=True)
        reporter = Reporter(self._session, name, self._profile, self._inputs, self._quality, own_usage())
        self._resume()
        worker.start()
        listener = PlanListener(
            self._session, name, lambda decision: self._decide(decision, reporter), self._guarded, key=plan_key
        )
        _LOG.info("running as task %s", name)
        stop.wait()
        self._inputs.close()
        self._producer.close()
        worker.join(LONGEST_RUN_S)
        self._guarded(lambda: self._attempt(self._task.close))()
        listener.close()
        reporter.close()
        if self._runs is not None:
            self._runs.close()
        self._presence.close()
        token.undeclare()
        if self._failure is not None:
            raise self._failure

    def _guarded(self, work: Callable[[], None]) -> Callable[[], None]:
        """Wrap a thread's work so that an exception stops the module and is raised by `run`."""

        def guarded() -> None:
            try:
                work()
            except BaseException as error:  # noqa: BLE001 - raised again by run()
                self._failure = self._failure or error
                self._stop.set()

        return guarded

    def _decide(self, decision: Decision, reporter: Reporter) -> None:
        """Obey before the task may do something of its own, which can fail; but resume a task that has adapted."""
        _LOG.info("%s", decision)
        if decision.suspended:
            self._inputs.pause()
            if self._presence is not None:
                self._presence.pause()
            self._producer.pause()
        self._quality.hint(decision.share, self._module.needs.cores)
        reporter.suspended(suspended=decision.suspended)
        self._attempt(lambda: self._task.adapt(decision))
        if not decision.suspended:
            self._resume()

    def _attempt(self, callback: Callable[[], None]) -> None:
        try:
            callback()
        except (DeviceError, ConfigurationError) as error:
            self._count(error)

    def _count(self, error: Exception) -> None:
        self._profile.failures += 1
        _LOG.warning("%s", error)

    def _resume(self) -> None:
        self._inputs.resume()
        if self._presence is not None:
            self._presence.resume()
        self._producer.resume()

    def _work(self) -> None:
        while (received := self._inputs.take()) is not None:
            record = self._profile.inputs[received.input]
            self._keep_quality()
            started, cpu = time.time_ns(), time.process_time_ns()
            try:
                results = list(as_results(self._task.process(received), self._module.outputs))
            except MessageError as error:
                record.broken += 1
                _LOG.warning("dropped a sample of %s: %s", received.input, error)
                continue
            except (DeviceError, ConfigurationError) as error:
                self._count(error)
                continue
            used, finished = time.process_time_ns() - cpu, time.time_ns()
            run = Run(received.stamp, received.received, started, finished, used)
            missed = record.add(run)
            self._quality.done(run, received.input)
            self._publish(results, received, run, missed=missed)

    def _keep_quality(self) -> None:
        if self._quality.value != self._set:
            self._set = self._quality.value
            self._task.set_quality(self._set)

    def _publish(self, results: list[Result], received: Received, run: Run, *, missed: bool) -> None:
        timing = {"input": received.input, **run._asdict(), "missed": missed}
        timing["dropped"] = self._inputs.dropped[received.input]
        if self._runs is not None:
            self._runs.add(timing)
        for result in results:
            stamped = result if result.stamp is not None else Result(result.output, result.value, _true_at(received))
            self._outputs.publish(stamped, timing)


def _true_at(received: Received) -> int:
    """When what a sample says was true: of a ROS message its header's stamp, by which ROS matches answers to it."""
    stamp = None
    if received.encoding == CDR:
        from robotkit.ros import has_header  # noqa: PLC0415 - an extra, and megabytes

        if has_header(received.type, release=received.ros, folder=received.types):
            stamp = header_stamp(received.payload)
    return received.stamp if stamp is None else stamp
