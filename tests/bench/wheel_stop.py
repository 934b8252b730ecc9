"""How long the wheels of a simulated Create 2 turn after something should have stopped them.

    python -m tests.bench.wheel_stop [--rounds 10]          needs root, for the cgroup of its own

Navigation and its guard run as programs, the robot behind a pseudo-terminal. Each case is measured without a CPU limit
and with navigation at the floor of a suspended task, 10m: 1 ms of CPU in 100 ms. The guard has 50m, less than its
sidecar. Latency is the time from the cause to the last moment at which a wheel turned within the three seconds that
follow.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import threading
import time
from contextlib import ExitStack

from modules.navigation.simulator import Create2
from robotkit.simulated import on_a_pseudo_terminal
from tests.bench.cgroup import cgroup
from tests.bench.child import Child, program
from tests.modules.robotkit.bus import client
from tests.ports import free_port

WATCHED_S = 3.0
PATIENCE_S = 120.0
SCAN_S = 1 / 5.5
ORDER, SCAN, PLAN = "robot/navigation/order", "robot/lidar/scan", "contextpolicy/bench/stop/plan"


class Timed(Create2):
    """A robot that knows when its wheels turned last."""

    def __init__(self):
        super().__init__()
        self.turned = 0.0

    def receive(self, data):
        before = any(self.wheels)
        answer = super().receive(data)
        if before or any(self.wheels):
            self.turned = time.monotonic()
        return answer

    def advance(self, seconds):
        if any(self.wheels):
            self.turned = time.monotonic()
        return super().advance(seconds)


class Scene:
    """A robot that drives, and everything around it."""

    def __init__(self, stack, cores, *, guarded):
        self.robot = Timed()
        device = stack.enter_context(on_a_pseudo_terminal(self.robot))
        address = f"tcp/127.0.0.1:{free_port()}"
        self.router = stack.enter_context(Child("-m", "contextpolicy", "router", "--listen", address))
        self.session = stack.enter_context(client(address))
        if guarded:
            guards = stack.enter_context(cgroup("wheel-stop-guard"))
            port = str(free_port())
            guard = ("-m", "modules.navigation.guard")
            self.guard = stack.enter_context(program(*guard, group=guards, ROBOT_PORT=device, GUARD_PORT=port))
            device = f"tcp://127.0.0.1:{port}"
        self.group = stack.enter_context(cgroup("wheel-stop"))
        heard = threading.Event()
        self.session.declare_subscriber("robot/navigation/odometry", lambda _: heard.set())
        self.navigation = stack.enter_context(
            program("-m", "modules.navigation", group=self.group, ZENOH_CONNECT=address, SERIAL_PORT=device)
        )
        if not heard.wait(PATIENCE_S):
            raise TimeoutError("navigation does not start")
        self.ended = threading.Event()
        stack.callback(self.ended.set)
        threading.Thread(target=self.scan, daemon=True).start()
        self.drive()
        if cores is not None:
            self.group.limit(cores)
        if guarded:
            guards.limit(0.05)
        time.sleep(1.0)
        self.drive()

    def scan(self):
        payload = json.dumps({"ranges": [3.0] * 360})
        while not self.ended.wait(SCAN_S):
            self.session.put(SCAN, payload)

    def drive(self):
        """Give a long route, and wait until the wheels turn."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            self.session.put(ORDER, '{"waypoints": [[900, 0]]}')
            until = time.monotonic() + 5
            while time.monotonic() < until:
                if any(self.robot.wheels):
                    return
                time.sleep(0.005)
        raise TimeoutError("the robot does not drive")

    def plan(self):
        mine = {"share": 0.01, "weight": 0.0, "suspended": True}
        message = {"run": time.time_ns(), "sequence": 1, "mode": "Enforce", "tasks": {"navigation": mine}}
        self.session.put(PLAN, json.dumps(message))


CAUSES = {
    "stop order": lambda scene: scene.session.put(ORDER, '{"stop": true}'),
    "suspended by a plan": lambda scene: scene.plan(),
    "bus gone": lambda scene: os.kill(scene.router.process, signal.SIGKILL),
    "SIGTERM": lambda scene: scene.navigation.terminate(),
    "killed": lambda scene: scene.navigation.kill(),
    "frozen (SIGSTOP)": lambda scene: scene.navigation.send_signal(signal.SIGSTOP),
}


def measure(cause, cores, *, guarded):
    """Give the latency in s; None: the wheels still turned at the end."""
    with ExitStack() as stack:
        scene = Scene(stack, cores, guarded=guarded)
        begun = time.monotonic()
        CAUSES[cause](scene)
        time.sleep(WATCHED_S)
        return None if any(scene.robot.wheels) else max(scene.robot.turned - begun, 0.0)


def reported(latencies):
    if None in latencies:
        return f"{latencies.count(None)} of {len(latencies)} drove on"
    return f"{statistics.median(latencies) * 1000:.0f} / {max(latencies) * 1000:.0f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--cause", choices=CAUSES, action="append")
    parser.add_argument("--without-guard", action="store_true")
    arguments = parser.parse_args()
    print("ms from the cause to the last turn of a wheel, median / worst")  # noqa: T201
    print(f"{'cause':<22} {'no limit':>22} {'10m':>22}")  # noqa: T201
    for cause in arguments.cause or CAUSES:
        columns = [
            reported([measure(cause, cores, guarded=not arguments.without_guard) for _ in range(arguments.rounds)])
            for cores in (None, 0.01)
        ]
        print(f"{cause:<22} {columns[0]:>22} {columns[1]:>22}", flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
