"""`python -m robotkit.sidecar module.yaml`: publish health and profile for a node without robotkit.

It runs beside a ROS 2 node, in the node's pod, and observes the node's inputs and outputs, which a module.yaml lists.
Environment: that of a module (ZENOH_CONNECT, ZENOH_CREDENTIALS, POLICY_TASK, PLAN_KEY, INPUT_..., OUTPUT_...), and
ANSWERS_ALL: false for a node that skips inputs on purpose.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Self

from robotkit.cgroup import Usage
from robotkit.errors import ConfigurationError
from robotkit.module import load_module
from robotkit.observed import Heard, Observed
from robotkit.other_processes import OtherProcesses
from robotkit.plan import PLAN_KEY, PlanListener
from robotkit.profile import Profile
from robotkit.quality import Quality
from robotkit.reporter import Reporter
from robotkit.session import credentials, endpoints, open_session, switch
from robotkit.stamps import attached, header_stamp
from robotkit.termination import stop_on_signals

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Mapping, Sequence

    import zenoh

    from robotkit.module import Input, Module, Output
    from robotkit.plan import Decision

STRANGE = 50
"""When so many answers and none before had an input's stamp, something is wrong, and it is logged."""

_LOG = logging.getLogger(__name__)


class Sidecar:
    """Observes one node while its `with` block runs; `task` is its name in the policy."""

    def __init__(
        self, session: zenoh.Session, module: Module, task: str, cpu: Callable[[], int], *, answers_all: bool
    ) -> None:
        self._session, self._module, self._task = session, module, task
        self._profile = Profile(module, cpu)
        self._observed = Observed(module, self._profile, cpu, answers_all=answers_all)
        usage = Usage(cpu, lambda: None)  # of the node's container; nobody outside of it sees how often it is throttled
        self._reporter = Reporter(session, task, self._profile, self._observed, Quality(None), usage)
        self._inputs: list[zenoh.Subscriber[None]] = []
        self._outputs: list[zenoh.Subscriber[None]] = []

    def __enter__(self) -> Self:
        self._outputs = [
            self._session.declare_subscriber(own.key, self._answer) for own in self._module.outputs.values()
        ]
        self._resume()
        return self

    def __exit__(self, *_: object) -> None:
        self._pause()
        for subscriber in self._outputs:
            subscriber.undeclare()
        self._reporter.close()

    def decide(self, decision: Decision) -> None:
        """A suspended node is asked for nothing: what it leaves undone then is no miss."""
        _LOG.info("%s", decision)
        if decision.suspended:
            self._pause()
        self._reporter.suspended(suspended=decision.suspended)
        if not decision.suspended:
            self._resume()

    def _resume(self) -> None:
        if not self._inputs:
            self._inputs = [
                self._session.declare_subscriber(own.key, self._receiver(name))
                for name, own in self._module.inputs.items()
            ]

    def _pause(self) -> None:
        for subscriber in self._inputs:
            subscriber.undeclare()
        self._inputs = []
        self._observed.forget()

    def _receiver(self, name: str) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            now, stamp = time.time_ns(), header_stamp(sample.payload.to_bytes())
            if stamp is None:
                self._profile.inputs[name].broken += 1
            else:
                self._observed.came(name, Heard(stamp, attached(sample).stamp or now, now))

        return receive

    def _answer(self, sample: zenoh.Sample) -> None:
        self._observed.answered(header_stamp(sample.payload.to_bytes()), time.time_ns())
        if not self._observed.matched and self._observed.strange == STRANGE:
            _LOG.warning(
                "none of %d messages on %s has the same header stamp as an input: expected answers that copy it",
                STRANGE,
                sample.key_expr,
            )


def load(path: Path, environment: Mapping[str, str]) -> Module:
    """The node's module.yaml; ConfigurationError names what can't be observed."""
    module = load_module(path, environment)
    streams: dict[str, Input | Output] = {f"inputs.{name}": own for name, own in module.inputs.items()}
    streams |= {f"outputs.{name}": own for name, own in module.outputs.items()}
    problems = [
        f"{path}: {name}.encoding: invalid value {own.encoding!r}: expected cdr, a message with a header"
        for name, own in streams.items()
        if own.encoding != "cdr"
    ]
    problems += [
        f"{path}: {what}: expected at least one" for what in ("inputs", "outputs") if not getattr(module, what)
    ]
    if problems:
        raise ConfigurationError("\n".join(problems))
    return module


def main(arguments: Sequence[str] | None = None) -> int:
    """Observe until SIGTERM or SIGINT; an invalid configuration ends it with one line and exit code 2."""
    parser = argparse.ArgumentParser(prog="python -m robotkit.sidecar", description=__doc__)
    parser.add_argument("module_yaml", type=Path, help="the node's inputs, outputs and needs")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s sidecar: %(message)s")
    try:
        _run(load(options.module_yaml, os.environ), os.environ)
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _run(module: Module, environment: Mapping[str, str]) -> None:
    addresses, secret = endpoints(environment), credentials(environment)
    answers_all, cpu = switch(environment, "ANSWERS_ALL", absent=True), OtherProcesses()
    task, stop = environment.get("POLICY_TASK") or module.name, stop_on_signals()
    with open_session(addresses, stop, secret=secret) as session:
        if session is None:
            return
        with Sidecar(session, module, task, cpu, answers_all=answers_all) as sidecar:
            plans = environment.get("PLAN_KEY", PLAN_KEY)
            listener = PlanListener(session, task, sidecar.decide, _ending(stop), key=plans)
            _LOG.info("watching task %s", task)
            stop.wait()
            listener.close()


def _ending(stop: threading.Event) -> Callable[[Callable[[], None]], Callable[[], None]]:
    """Wraps a thread's work, so that whatever it fails with ends the sidecar, and Kubernetes starts it again."""

    def guard(work: Callable[[], None]) -> Callable[[], None]:
        def guarded() -> None:
            try:
                work()
            finally:
                stop.set()

        return guarded

    return guard


if __name__ == "__main__":
    sys.exit(main())
