"""Resident memory and idle CPU of a process that has what `contextpolicy run` has: measured in a child of its own."""

from __future__ import annotations

import subprocess
import sys
import textwrap

IDLE_SECONDS = 10.0

_IMPORTS = """
import os, kopf, kubernetes, zenoh, reactivex, cel, prometheus_client
from contextpolicy.planning.observable import plan_with
from contextpolicy.planning.planner import Planner
from tests.planning.quiet import Quiet
from tests.bench.engine_case import NAMED
from tests.bench.engine_measure import Engine
from tests.bench.footprint.processes import resident
"""

_RESIDENT = (
    _IMPORTS
    + """
engine = Engine(NAMED)
for at, stream, payload in NAMED.payloads(20_000):
    engine.take(at, stream, payload)
print(resident(os.getpid()) / 2**20)
"""
)

_IDLE = (
    _IMPORTS
    + """
import asyncio, resource, time
from reactivex import Subject
from reactivex.scheduler.eventloop import AsyncIOScheduler

async def main(seconds):
    inputs = Subject()
    scheduler = AsyncIOScheduler(asyncio.get_running_loop())
    inputs.pipe(plan_with(Planner(NAMED.policy(), Quiet(), {}), scheduler)).subscribe()
    inputs.on_next(NAMED.placement())
    await asyncio.sleep(2)
    begin = time.process_time()
    await asyncio.sleep(seconds)
    print(100 * (time.process_time() - begin) / seconds)

asyncio.run(main(IDLE_SECONDS))
"""
)


def resident_mb() -> float:
    """After 20,000 samples of the named case."""
    return _run(_RESIDENT)


def idle_cpu_percent() -> float:
    """Of one core, on a real event loop, while all streams of the named case are silent."""
    return _run(_IDLE.replace("IDLE_SECONDS", str(IDLE_SECONDS)))


def _run(program: str) -> float:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], check=True, capture_output=True, text=True, timeout=120
    )
    return float(done.stdout.split()[-1])
