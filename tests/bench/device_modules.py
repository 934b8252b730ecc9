"""What navigation, lidar and arm cost, and how exact they are on their simulators.

    python -m tests.bench.device_modules [--seconds 20]

Cost: each runs as a program against its simulator, and the kernel reports its CPU time (m: thousandths of a core) and
its memory. Accuracy is computed in virtual time: odometry over laps of a 2 m square, the arm over its workspace.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import math
import random
import threading
import time
from contextlib import ExitStack

from modules.arm.joints import NAMES, load_arm
from modules.arm.kinematics import Unreachable
from modules.arm.servos import QUARTERS
from modules.arm.simulator import Maestro
from modules.lidar.simulator import ROOM as LIDAR_ROOM
from modules.lidar.simulator import RplidarA1, seen
from modules.navigation import open_interface as oi
from modules.navigation import packets
from modules.navigation.odometry import Odometry
from modules.navigation.simulator import Body, Create2
from modules.navigation.waypoints import Route
from robotkit.simulated import on_a_pseudo_terminal
from tests.bench.child import program
from tests.bench.footprint.processes import cpu, resident
from tests.bench.wheel_stop import ORDER, SCAN, SCAN_S
from tests.modules.robotkit.bus import client, router
from tests.node.layout import REPOSITORY
from tests.ports import free_port

LAPS = 5
SQUARE = [(2, 0), (2, 2), (0, 2), (0, 0)]
BODIES = {
    "perfect wheels": {},
    "wheels that slip by 1 % of each 15 ms at random": {"slip_deviation": 0.01},
    "a right wheel 0.5 % larger than nominal": {"slip_bias": (0.0, 0.005)},
}


def drift(body):
    """Drive the laps by odometry; give the metres driven, how far off the odometry is then, and by which angle."""
    robot, odometry, route = Create2(Body(**body)), Odometry(), Route(SQUARE * LAPS)
    robot.receive(oi.START + oi.SAFE)
    cycle = 0
    while True:
        values = robot.values()
        pose = odometry.update(values[packets.LEFT_ENCODER], values[packets.RIGHT_ENCODER])
        if cycle % 3 == 0:
            motion = route.next_motion(pose)
            if motion is None:
                break
            left, right = motion.wheels()
            robot.receive(oi.drive_direct(right=right, left=left))
        robot.advance(robot.period)
        cycle += 1
    true = robot.body.pose
    return odometry.travelled, math.dist((true.x, true.y), (pose.x, pose.y)), true.heading - pose.heading


def arm_error():
    """How far from its target a grip is whose pulses have been rounded, in mm: worst of the workspace."""
    arm = load_arm(REPOSITORY / "modules/arm/arm.yaml")
    dice, worst, found = random.Random(0), 0.0, 0  # noqa: S311 - it must repeat itself
    while found < 2000:
        point = (dice.uniform(0, 230), dice.uniform(-230, 230), dice.uniform(-60, 160))
        try:
            posture = arm.posture_at(point, grip=0)
        except Unreachable:
            continue
        found += 1
        joints = arm.joints
        rounded = {
            name: joints[name].angle_at(round(joints[name].pulse_at(posture[name]) * QUARTERS) / QUARTERS)
            for name in NAMES
        }
        worst = max(worst, math.dist(arm.grip_at(rounded), point))
    return worst


class Bus:
    """A router, a session, and what keeps the modules busy."""

    def __init__(self, stack):
        self.address = stack.enter_context(router())
        self.session = stack.enter_context(client(self.address))
        self.ended = threading.Event()
        stack.callback(self.ended.set)

    def repeat(self, key, messages, period):
        def run():
            count = 0
            while not self.ended.wait(period):
                self.session.put(key, json.dumps(messages[count % len(messages)]))
                count += 1

        threading.Thread(target=run, daemon=True).start()


def cost(name, seconds, processes):
    time.sleep(3)
    before = {part: cpu(process.pid) for part, process in processes.items()}
    time.sleep(seconds)
    for part, process in processes.items():
        used = (cpu(process.pid) - before[part]) / seconds
        print(f"{name + ' ' + part:<34} {used * 1000:>6.1f}m {resident(process.pid) / 2**20:>6.1f} MiB", flush=True)


def navigation(seconds, *, driving):
    with ExitStack() as stack:
        bus, device = Bus(stack), stack.enter_context(on_a_pseudo_terminal(Create2()))
        port = str(free_port())
        guard = stack.enter_context(program("-m", "modules.navigation.guard", ROBOT_PORT=device, GUARD_PORT=port))
        environment = {"ZENOH_CONNECT": bus.address, "SERIAL_PORT": f"tcp://127.0.0.1:{port}"}
        task = stack.enter_context(program("-m", "modules.navigation", **environment))
        bus.repeat(SCAN, [{"ranges": [3.0] * 360}], SCAN_S)
        if driving:
            bus.repeat(ORDER, [{"waypoints": [[900, 0]]}], 1)
        cost("navigation," + (" driving" if driving else " standing"), seconds, {"": task, "(guard)": guard})


def lidar(seconds, mode):
    with ExitStack() as stack:
        simulated = RplidarA1(lambda angle: seen(LIDAR_ROOM, 0, 0, -math.radians(angle)))
        bus, device = Bus(stack), stack.enter_context(on_a_pseudo_terminal(simulated))
        environment = {"ZENOH_CONNECT": bus.address, "SERIAL_PORT": device, "LIDAR_MODE": mode}
        cost(f"lidar, {mode}", seconds, {"": stack.enter_context(program("-m", "modules.lidar", **environment))})


def arm(seconds, *, moving):
    with ExitStack() as stack:
        bus, device = Bus(stack), stack.enter_context(on_a_pseudo_terminal(Maestro()))
        environment = {"ZENOH_CONNECT": bus.address, "SERIAL_PORT": device}
        task = stack.enter_context(program("-m", "modules.arm", **environment))
        if moving:
            bus.repeat("robot/arm/order", [{"move": [68, 120, 60]}, {"move": [68, -120, 60]}], 2)
        cost("arm, " + ("moving" if moving else "resting"), seconds, {"": task})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20)
    seconds = parser.parse_args().seconds
    for name, body in BODIES.items():
        travelled, apart, turned = drift(body)
        degrees = math.degrees(math.remainder(turned, math.tau))
        print(f"{name}: {travelled:.1f} m driven, {apart * 1000:.0f} mm off, {degrees:.1f} degrees")
    print(f"arm: at most {arm_error():.2f} mm off by the resolution of the pulses")
    navigation(seconds, driving=True)
    navigation(seconds, driving=False)
    lidar(seconds, "standard")
    lidar(seconds, "express")
    arm(seconds, moving=True)
    arm(seconds, moving=False)


if __name__ == "__main__":
    main()
