"""`python -m tests.bench.frames`: what shared memory saves when frames go from a camera through the router to a module.

Three processes, as three pods would be: CPU of each per frame, and the time from put to its bytes in the module.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from contextlib import ExitStack
from statistics import median

import zenoh

from robotkit.session import client_config
from tests.bench.child import Child
from tests.modules.robotkit.bus import router_config
from tests.ports import free_port

KEY = "bench/frame"
PERIOD_S = 0.02


def main() -> None:
    """Print a table: without and with shared memory, one after the other."""
    options = _parser().parse_args()
    if options.role:
        ROLES[options.role](options)
        return
    _say(f"{options.frames} frames of {options.size} bytes, {1 / PERIOD_S:.0f} a second; CPU in ms per frame")
    _say(f"{'shared memory':14} {'camera':>7} {'router':>7} {'module':>7} {'sum':>7} {'delay (ms)':>11} {'shared':>7}")
    for shared in ("false", "true"):
        reported = _measure(options, shared)
        cpu = [reported[role]["cpu"] / options.frames * 1000 for role in ("camera", "router", "module")]
        figures = " ".join(f"{figure:7.2f}" for figure in (*cpu, sum(cpu)))
        _say(f"{shared:14} {figures} {reported['module']['delay'] * 1000:11.2f} {reported['module']['shared']:7}")


def _measure(options: argparse.Namespace, shared: str) -> dict[str, dict[str, float]]:
    address = f"tcp/127.0.0.1:{free_port()}"
    arguments = ["--address", address, "--size", str(options.size), "--frames", str(options.frames), "--shared", shared]
    with ExitStack() as stack:
        running = {
            role: stack.enter_context(Child("-m", "tests.bench.frames", "--role", role, *arguments)) for role in ROLES
        }
        return {role: running[role].ask() for role in ("camera", "module", "router")}


def _router(options: argparse.Namespace) -> None:
    with zenoh.open(router_config(options.address, shared_memory=options.shared)):
        _say(json.dumps({"cpu": _cpu_until_asked()}))


def _module(options: argparse.Namespace) -> None:
    delays, shared = [], 0

    def hear(sample: zenoh.Sample) -> None:
        nonlocal shared
        shared += sample.payload.as_shm() is not None
        sent = int.from_bytes(sample.payload.to_bytes()[:8], "little")
        delays.append((time.time_ns() - sent) / 1e9)

    with zenoh.open(client_config([options.address], shared_memory=options.shared)) as session:
        session.declare_subscriber(KEY, hear)
        _say(json.dumps({"cpu": _cpu_until_asked(), "delay": median(delays), "shared": shared}))


def _camera(options: argparse.Namespace) -> None:
    rest = os.urandom(options.size - 8)
    with zenoh.open(client_config([options.address], shared_memory=options.shared)) as session:
        publisher = session.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.DROP, express=True)
        _say("ready")
        before = time.process_time()
        for _ in range(options.frames):
            publisher.put(time.time_ns().to_bytes(8, "little") + rest)
            time.sleep(PERIOD_S)
        _say(json.dumps({"cpu": time.process_time() - before}))


def _cpu_until_asked() -> float:
    _say("ready")
    before = time.process_time()
    sys.stdin.readline()
    return time.process_time() - before


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.frames", description=__doc__)
    parser.add_argument("--size", type=int, default=400_000, help="bytes of a frame (%(default)s)")
    parser.add_argument("--frames", type=int, default=500, help="how many (%(default)s)")
    parser.add_argument("--role", choices=ROLES, help=argparse.SUPPRESS)
    parser.add_argument("--address", help=argparse.SUPPRESS)
    parser.add_argument("--shared", type=lambda text: text == "true", help=argparse.SUPPRESS)
    return parser


ROLES = {"router": _router, "module": _module, "camera": _camera}

if __name__ == "__main__":
    main()
