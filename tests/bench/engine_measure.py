"""Throughput and latency of one case, as fast as one core can."""

from __future__ import annotations

import cProfile
import gc
import io
import os
import platform
import pstats
import statistics
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter_ns, thread_time_ns
from typing import TYPE_CHECKING

from contextpolicy.planning.planner import Planner
from contextpolicy.streams.decoding import Decoder

if TYPE_CHECKING:
    from tests.bench.engine_case import Case

    Batch = list[tuple[float, str, bytes]]

ROUNDS = 7
BATCH = 2_000
START = 1_000.0


@dataclass(frozen=True, slots=True)
class Measurement:
    """Of a sample that makes a plan, the time from bytes to plan; of all samples, how many a second."""

    samples_per_second: float
    plan_p50_us: float
    plan_p99_us: float
    samples: int
    plans: int


class Engine:
    """What a sample meets in the operator between Zenoh and the actuators."""

    def __init__(self, case: Case) -> None:
        policy = case.policy()
        self.planner = Planner(policy)
        self.decoders = {stream.name: Decoder(stream) for stream in policy.streams}
        self.planner.start(START)
        self.planner.handle(case.placement(), START)

    def take(self, at: float, stream: str, payload: bytes) -> int:
        """The number of new plans."""
        return len(self.planner.handle(self.decoders[stream].decode(payload), START + at))


def measure(case: Case) -> Measurement:
    """Some rounds for throughput, as many for latency; the first of all warms up."""
    engine = Engine(case)
    batch = list(case.payloads(BATCH))
    length = batch[-1][0] + 1e-3
    gc.collect()
    round_ns = min([_round(engine, batch, number * length) for number in range(ROUNDS)][1:])
    latencies = [_latencies(engine, batch, number * length) for number in range(ROUNDS, 2 * ROUNDS)]
    return Measurement(
        samples_per_second=BATCH / (round_ns / 1e9),
        plan_p50_us=min(_percentile(of_round, 50) for of_round in latencies),
        plan_p99_us=min(_percentile(of_round, 99) for of_round in latencies),
        samples=BATCH,
        plans=len(latencies[-1]),
    )


def _round(engine: Engine, batch: Batch, offset: float) -> int:
    begin = thread_time_ns()
    for at, stream, payload in batch:
        engine.take(offset + at, stream, payload)
    return thread_time_ns() - begin


def _latencies(engine: Engine, batch: Batch, offset: float) -> list[int]:
    """From bytes to plan, of each sample that made one."""
    durations = []
    for at, stream, payload in batch:
        begin = perf_counter_ns()
        if engine.take(offset + at, stream, payload):
            durations.append(perf_counter_ns() - begin)
    return durations


def profile(case: Case) -> str:
    """Where a case's time goes, by own time."""
    engine = Engine(case)
    batch = list(case.payloads(20_000))
    profiler = cProfile.Profile()
    profiler.enable()
    for at, stream, payload in batch:
        engine.take(at, stream, payload)
    profiler.disable()
    text = io.StringIO()
    pstats.Stats(profiler, stream=text).strip_dirs().sort_stats("tottime").print_stats(25)
    return text.getvalue()


def machine() -> dict[str, str | float]:
    """What the figures were measured on."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "cpu": models[0] if models else platform.processor(),
        "cores": os.cpu_count() or 0,
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 1),
        "system": f"{platform.system()} {platform.release()}",
    }


def _percentile(durations: list[int], percent: int) -> float:
    if len(durations) < 2:
        return durations[0] / 1e3 if durations else 0.0
    return statistics.quantiles(durations, n=100, method="inclusive")[percent - 1] / 1e3
