"""What a container costs a module: the module imu in a pod and as a bare process, in turns, on the same 200 samples/s.

    python -m tests.node exec -- python -m tests.bench.container [--seconds 20]

Both speak through the same router in a pod. Needs the images contextpolicy:dev and contextpolicy-imu:dev on the node
and to run as root there. Prints a table, writes build/bench/container.json.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.bench.child import program
from tests.bench.engine_measure import machine
from tests.bench.footprint import processes
from tests.bench.reaction import objects
from tests.bench.reaction.figures import rounded
from tests.bench.reaction.hearing import Hearing
from tests.bench.reaction.site import ADDRESSES, PLAIN, Site, say
from tests.bench.reaction.stopwatch import Stopwatch
from tests.bench.results import keep
from timelines.demo.deploy import free_address

if TYPE_CHECKING:
    import zenoh

RATE = 200
SETTLING, TURNS = 3.0, 3
MIB = 1 << 20


class Subject(NamedTuple):
    """One of the two, where it is heard, and its process."""

    name: str
    answers: Hearing
    process: int

    @property
    def key(self) -> str:
        """What it listens to."""
        return f"bench/{self.name}/raw"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each turn (%(default)s)")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as after Ctrl-C, nothing is left behind
    with Stopwatch() as stopwatch, Site(stopwatch) as site:
        result = {**_measure(site, options.seconds), "machine": machine()}
    keep("container", result)
    print(_text(result))
    return 0


def _measure(site: Site, seconds: float) -> dict[str, Any]:
    router = f"tcp/{free_address(ADDRESSES[PLAIN])}:7447"
    bus = site.operator(PLAIN)
    site.module(PLAIN, objects.module_pod("imu", PLAIN, environment("pod", router)))
    [contained] = site.groups[PLAIN]["imu"].processes()
    with program("-m", "modules.imu", group=None, **environment("process", router)) as bare:
        subjects = [
            Subject(name, Hearing(bus, f"bench/{name}/motion"), process)
            for name, process in (("process", bare.pid), ("pod", contained))
        ]
        time.sleep(SETTLING)
        turns: dict[str, list[dict[str, float | None]]] = {one.name: [] for one in subjects}
        for turn in range(TURNS):
            for one in subjects:
                say(f"turn {turn + 1} of {TURNS}: {one.name}")
                turns[one.name].append(_turn(bus, one, seconds))
        memory = {one.name: round(processes.resident(one.process) / MIB, 1) for one in subjects}
    shim = round(processes.resident(processes.parent(contained)) / MIB, 1)
    return {"turns": turns, "memory_mib": memory, "shim_mib": shim}


def environment(name: str, router: str) -> dict[str, str]:
    """The module's settings."""
    return {
        "ZENOH_CONNECT": router,
        "INPUT_RAW": f"{{key: bench/{name}/raw}}",
        "OUTPUT_MOTION": f"bench/{name}/motion",
    }


def _turn(bus: zenoh.Session, subject: Subject, seconds: float) -> dict[str, float | None]:
    """CPU of a sample, and milliseconds until the answer to one is heard."""
    publisher = bus.declare_publisher(subject.key, express=True)
    before, began = processes.cpu(subject.process), time.monotonic()
    since, number = time.time(), 0
    while number < seconds * RATE:
        time.sleep(max(0.0, began + number / RATE - time.monotonic()))
        publisher.put(json.dumps({"stamp": time.time_ns(), "gyro": [0.0, 0.0, 0.1], "accel": [0.0, 0.0, 9.81]}))
        number += 1
    time.sleep(0.5)
    publisher.undeclare()
    delays = [(at - message["stamp"] / 1e9) * 1e3 for at, message in subject.answers.since(since)]
    return {
        "cpu_us_per_sample": round((processes.cpu(subject.process) - before) / number * 1e6),
        "answer_ms_p50": rounded(delays, 50),
        "answer_ms_p99": rounded(delays, 99),
    }


def _text(result: dict[str, Any]) -> str:
    lines = [
        str(result["machine"]),
        "",
        f"{'':10}{'CPU us a sample':>26}{'answer, p50 ms':>22}{'p99 ms':>22}{'MiB':>8}",
    ]
    for name, turns in result["turns"].items():
        reported = [", ".join(f"{turn[key]:g}" for turn in turns) for key in turns[0]]
        lines.append(f"{name:10}{reported[0]:>26}{reported[1]:>22}{reported[2]:>22}{result['memory_mib'][name]:>8}")
    return "\n".join([*lines, "", f"a pod's shim: {result['shim_mib']} MiB"])


if __name__ == "__main__":
    sys.exit(main())
