"""Throughput and latency of one case, as fast as one core can."""

from __future__ import annotations

import cProfile
import gc
import io
import math
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
from tests.bench.engine_floor import Floor
from tests.bench.reaction.figures import percentile
from tests.planning.quiet import Quiet

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
    beside: Beside


@dataclass(frozen=True, slots=True)
class Beside:
    """Means in us, engine and floor sample by sample in turns; None where every sample makes a plan.

    Of each sample the quickest of the rounds: what interrupted one of them is no cost of either.
    """

    quiet_us: float | None
    quiet_floor_us: float | None
    plan_us: float
    plan_floor_us: float


class Engine:
    """What a sample meets in the operator between Zenoh and the actuators."""

    def __init__(self, case: Case) -> None:
        policy = case.policy()
        self.planner = Planner(policy, Quiet(), {})
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
        plan_p50_us=min(percentile(of_round, 50) for of_round in latencies) / 1e3,
        plan_p99_us=min(percentile(of_round, 99) for of_round in latencies) / 1e3,
        samples=BATCH,
        plans=len(latencies[-1]),
        beside=_beside(engine, Floor(case.policy()), batch, length),
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


def _beside(engine: Engine, floor: Floor, batch: Batch, length: float) -> Beside:
    """`length` is that of a round, in seconds of the samples' time."""
    costs = [[math.inf, math.inf] for _ in batch]
    planning = [False] * len(batch)
    for number in range(2 * ROUNDS, 3 * ROUNDS):
        for place, (at, stream, payload) in enumerate(batch):
            begin = perf_counter_ns()
            planning[place] |= engine.take(number * length + at, stream, payload) > 0
            between = perf_counter_ns()
            floor.take(stream, payload)
            took = between - begin, perf_counter_ns() - between
            costs[place] = [min(known, new) for known, new in zip(costs[place], took, strict=True)]
    quiet = [cost for cost, plans in zip(costs, planning, strict=True) if not plans]
    busy = [cost for cost, plans in zip(costs, planning, strict=True) if plans]
    return Beside(_mean_us(quiet, 0), _mean_us(quiet, 1), _mean_us(busy, 0) or 0.0, _mean_us(busy, 1) or 0.0)


def _mean_us(costs: list[list[float]], column: int) -> float | None:
    return statistics.fmean(cost[column] for cost in costs) / 1e3 if costs else None


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
