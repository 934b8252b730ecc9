"""Realtime (Eq. 2): budgets and priorities follow the context, hold busy tasks to their part, and are taken back."""

import json
import os
import time

import pytest

from contextpolicy.streams.zenoh_session import open_visitor
from tests.e2e.agents import (
    NAMESPACE,
    PRIORITY,
    SYSTEM,
    Component,
    budgets,
    budgets_above,
    group,
    installed,
    policies,
    usage,
)
from tests.e2e.cluster import delete, run, until
from tests.e2e.robot import Robot, Sensors, task

REALTIME, ORDINARY = {(os.SCHED_RR, PRIORITY)}, {(os.SCHED_OTHER, 0)}
STANDING, MOVING, SUSPENDED = {"slam": 50, "speech": 200}, {"slam": 200, "speech": 50}, {"slam": 200, "speech": 1}

BUSY = """
import subprocess, threading, time
def work():
    while True: pass
def births():
    while True:
        thread = threading.Thread(target=time.sleep, args=(0.3,)); thread.start()
        subprocess.run(["python3", "-c", "pass"])
threading.Thread(target=births).start()
work()
"""
"""Never idle, and threads and processes are born all the time."""

GREEDY = """
import os
for _ in range(os.cpu_count()): os.fork()
while True: pass
"""
"""A busy process for each processor, and one more."""

TASKS = [task("slam", max="200m", idle=4), task("speech", max="200m", idle=1)]
SPEC = {
    "scheduler": "Realtime",
    "tasks": [task("slam", max="200m"), task("speech", max="200m")],
    "contexts": [
        {"name": "standing", "when": "imu.speed <= 0.05", "tasks": {"slam": {"weight": 1}, "speech": {"weight": 100}}},
    ],
}


@pytest.fixture(scope="module")
def session():
    with installed() as endpoint, open_visitor([endpoint], patience=20) as opened:
        yield opened


@pytest.fixture(scope="module")
def agent(session):  # noqa: ARG001 - installed with it
    return Component("agent")
