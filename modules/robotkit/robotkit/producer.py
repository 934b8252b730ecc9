"""Runs `Task.produce` while the task is not suspended, and restarts it after its device was lost."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

from robotkit.errors import ConfigurationError, DeviceError
from robotkit.profile import Run

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotkit.outputs import Outputs
    from robotkit.profile import Profile
    from robotkit.task import Task

FIRST_RETRY_S, LAST_RETRY_S = 0.5, 30.0
LONGEST_END_S = 0.1

_LOG = logging.getLogger(__name__)


class Producer:
    """Owns the producing thread, one at a time; `guard` wraps its work so that a failure ends the module.

    Plans resume and pause it on another thread than the one that ends the module.
    """

    def __init__(
        self, task: Task, outputs: Outputs, profile: Profile, guard: Callable[[Callable[[], None]], Callable[[], None]]
    ) -> None:
        self._task = task
        self._outputs = outputs
        self._profile = profile
        self._guard = guard
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._closed = False

    def resume(self) -> None:
        """Start producing; does nothing if already started, or closed."""
        with self._lock:
            if self._thread is None and not self._closed:
                self._ended = ended = threading.Event()
                work = self._guard(lambda: self._produce(ended))
                self._thread = threading.Thread(target=work, name="produce", daemon=True)
                self._thread.start()

    def pause(self) -> None:
        """Signal the task to end and wait for it up to LONGEST_END_S, so that its device is free when it is resumed."""
        with self._lock:
            self._end()

    def close(self) -> None:
        """Pause for good."""
        with self._lock:
            self._closed = True
            self._end()

    def _end(self) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join(LONGEST_END_S)
            self._thread = None

    def _produce(self, ended: threading.Event) -> None:
        """Produce until the end; the pause between attempts to reach a lost device doubles."""
        retry = FIRST_RETRY_S
        while not ended.is_set():
            produced = self._profile.produced.done
            try:
                self._publish_all(ended)
            except (DeviceError, ConfigurationError) as error:  # a recording may turn out broken halfway
                self._profile.failures += 1
                retry = FIRST_RETRY_S if self._profile.produced.done > produced else min(2 * retry, LAST_RETRY_S)
                _LOG.warning("%s; retrying in %g s", error, retry)
                ended.wait(retry)
            else:
                return

    def _publish_all(self, ended: threading.Event) -> None:
        results = self._task.produce(ended)
        cpu = time.process_time_ns()
        try:
            for result in results:
                if ended.is_set():
                    return
                ready = time.time_ns()
                self._outputs.publish(result)
                now, cpu_now = time.time_ns(), time.process_time_ns()
                stamp = ready if result.stamp is None else result.stamp
                self._profile.produced.add(Run(stamp, ready, ready, now, cpu_now - cpu))
                cpu = cpu_now
        finally:
            close = getattr(results, "close", None)  # a generator releases its device in `finally`
            if close is not None:
                close()
