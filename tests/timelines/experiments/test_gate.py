"""What a dry run would suspend pauses modules on a bus as closed as the experiments' own."""

from __future__ import annotations

import json
from queue import Queue

import pytest
import zenoh

from contextpolicy.bus.session import open_router
from robotkit.plan import Decision, PlanListener
from tests.bus.certificates import Authority
from tests.bus.client import client_of
from tests.modules.robotkit.bus import Matching
from tests.ports import free_port
from tests.waiting import PATIENCE
from timelines.experiments.gate import EVERYTHING, KEY, Gate

PLAN = "contextpolicy/robot/whole-robot/plan"


def plan(sequence, *, suspended):
    tasks = {"slam": {"share": 0.2, "weight": 3.0, "suspended": suspended}}
    return json.dumps({"run": 1, "sequence": sequence, "mode": "DryRun", "tasks": tasks})


@pytest.fixture
def join(tmp_path):
    """Connects in a role."""
    authority, endpoint = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}"
    with open_router([endpoint], authority.issue("router")):
        yield lambda role: client_of(endpoint, authority.issue(role))


def test_modules_pause_and_resume_with_a_dry_runs_plans(join):
    decided: Queue[Decision] = Queue()
    with join("operator") as operator, join("module") as viewer, join("module") as module:
        listener = PlanListener(module, "slam", decided.put, lambda work: work, key=KEY)
        publisher, relayed = operator.declare_publisher(PLAN), viewer.declare_publisher(KEY)
        Matching(relayed).wait(expected=True)
        with Gate(viewer):
            Matching(publisher).wait(expected=True)
            publisher.put(plan(1, suspended=True))
            assert decided.get(timeout=PATIENCE).suspended
            publisher.put(plan(2, suspended=False))
            assert decided.get(timeout=PATIENCE) == Decision(EVERYTHING, 3.0, suspended=False)
        listener.close()


def test_plans_overtake_pictures_as_the_operators_own_do(join):
    """The queue to a starved module is full of pictures; what waits behind them for too long is dropped."""
    heard: Queue[zenoh.Sample] = Queue()
    with join("operator") as operator, join("module") as viewer, join("module") as module:
        publisher, relayed = operator.declare_publisher(PLAN), viewer.declare_publisher(KEY)
        subscriber = module.declare_subscriber(KEY, heard.put)
        Matching(relayed).wait(expected=True)
        with Gate(viewer):
            Matching(publisher).wait(expected=True)
            publisher.put(plan(1, suspended=True))
            sample = heard.get(timeout=PATIENCE)
        subscriber.undeclare()
    assert (sample.priority, sample.express) == (zenoh.Priority.REAL_TIME, True)
