"""An operator as a process of its own: what it costs, and what it says that the API has accepted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from typing import TYPE_CHECKING, Self

from tests.bench.footprint import processes
from tests.node.layout import REPOSITORY
from tests.ports import free_port

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import zenoh

PATIENCE = 120.0
SCHEDULED = 2
"""With a process id in the other bits, inverted: the clock of all its CPU time (clock_getcpuclockid), to the ns."""


class MeasuredOperator:
    """`contextpolicy run`, of this checkout."""

    def __init__(self, kubeconfig: Path, router: str) -> None:
        self._health = free_port()
        self.log = kubeconfig.parent / "operator.log"
        self._log = self.log.open("w")
        self._began = time.monotonic()
        environment = {
            **os.environ,
            "PYTHONPATH": str(REPOSITORY / "operator"),
            "KUBECONFIG": str(kubeconfig),
            "ZENOH_CONNECT": router,
            "HEALTH_PORT": str(self._health),
            "METRICS_PORT": str(free_port()),
        }
        command = [sys.executable, "-m", "contextpolicy", "run"]
        self._process = subprocess.Popen(command, env=environment, cwd=REPOSITORY, stdout=self._log, stderr=self._log)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            print(self.log.read_text(encoding="utf-8")[-4000:], file=sys.stderr)  # noqa: T201 - why the run has failed
        self._process.terminate()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    def wait_until_serving(self) -> float:
        """Seconds from its start until it has listed everything and answers."""
        while time.monotonic() < self._began + PATIENCE:
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{self._health}/healthz", timeout=30):
                    return time.monotonic() - self._began
            except (urllib.error.URLError, OSError):
                if self._process.poll() is not None:
                    raise RuntimeError("the operator has ended") from None
                time.sleep(0.1)
        raise RuntimeError("the operator never serves")

    def cpu(self) -> float:
        """Seconds of CPU since it started."""
        return time.clock_gettime(~self._process.pid << 3 | SCHEDULED)

    def resident(self) -> float:
        """MiB now."""
        return processes.resident(self._process.pid) / 2**20

    def peak(self) -> float:
        """The most MiB that it ever had."""
        return processes.peak(self._process.pid) / 2**20


class Applied:
    """What all policies say of the resizes that the API has accepted."""

    def __init__(self, bus: zenoh.Session) -> None:
        self._times: list[float] = []
        self._changed = threading.Condition()
        self._subscriber = bus.declare_subscriber("contextpolicy/*/*/applied", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        step = json.loads(sample.payload.to_bytes())
        if step["stage"] == "accepted":
            with self._changed:
                self._times.append(step["time"])
                self._changed.notify_all()

    def wait(self, count: int) -> None:
        """Until there are this many."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self._times) >= count, PATIENCE):
                raise RuntimeError(f"{len(self._times)} of {count} resizes were accepted in {PATIENCE:g} s")

    def after(self, act: Callable[[], None], count: int) -> list[float]:
        """Seconds from `act` until each of the next `count` resizes was accepted, in order."""
        with self._changed:
            self._times.clear()
        began = time.time()
        act()
        self.wait(count)
        with self._changed:
            return sorted(moment - began for moment in self._times)
