"""One short run without a node: a real bus, a real module, and the recording that the measures read."""

from __future__ import annotations

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from contextpolicy.streams.timeline import load
from robotkit import Input, Module, Needs, Task
from robotkit.runner import Runner
from tests.modules.robotkit.bus import client, router
from timelines.demo import deploy
from timelines.experiments import installation, measures
from timelines.experiments import run as run_module
from timelines.experiments.configurations import ALONE, LINUX_DEFAULT
from timelines.experiments.measures import Fate
from timelines.experiments.raw_data import read_run
from timelines.experiments.run import PROFILES, RUN, TimelineSource, execute
from timelines.experiments.trials import Trial

SLAM = Module(
    "slam",
    inputs={"stereo": Input("robot/camera/stereo", depth=1000)},
    needs=Needs(deadline=0.1),
)
TIMELINE: dict[str, Any] = {
    "name": "short",
    "duration": 0.5,
    "phases": [{"name": "drives", "from": 0, "to": 0.5, "truth": {"moving": True}}],
    "inputs": [{"key": "robot/camera/stereo", "encoding": "json", "from": 0, "to": 0.5, "rate": 20, "value": {"n": 1}}],
}


class Busy(Task):
    """Takes its time, so that inputs queue up, and publishes nothing."""

    def process(self, received):
        del received
        threading.Event().wait(0.02)


@pytest.fixture
def node(monkeypatch):
    """In place of the node: a router, and the robot's only module on a thread."""
    stop = threading.Event()
    with router() as address, client(address) as inside, ThreadPoolExecutor(1) as pool:
        monkeypatch.setattr(deploy, "TASKS", ("slam",))
        monkeypatch.setattr(installation, "start_robot", lambda *_: None)
        monkeypatch.setattr(installation, "stop_robot", lambda: None)
        monkeypatch.setattr(installation, "decide", lambda *_: None)
        monkeypatch.setattr(installation, "cgroups", dict)
        monkeypatch.setattr(run_module, "CALM", 0.0)
        monkeypatch.setattr(installation, "session", lambda *_: client(address))
        running = pool.submit(Runner(inside, SLAM, Busy(), shared_memory=False).run, stop, publish_runs=True)
        yield
        stop.set()
        running.result()


def test_every_input_of_a_run_is_accounted_for(node, tmp_path):  # noqa: ARG001
    timeline = tmp_path / "short.json"
    timeline.write_text(json.dumps(TIMELINE), encoding="utf-8")
    execute(Trial("exp3", 2.0, LINUX_DEFAULT, 0), timeline, tmp_path, tmp_path / "run")
    run = read_run(tmp_path / "run")
    assert run.drained
    done = run.about["counted"]["slam"]["stereo"]
    assert done > 0
    assert len(run.published["robot/camera/stereo"]) == 10
    fates = measures.counts(run, "slam")
    assert (fates[Fate.PROCESSED], fates[Fate.LOST]) == (done, 10 - done)  # a busy machine's bus may drop one
    found = measures.response(run, "slam")
    assert found.due == 10
    assert found.p50 is not None
    assert found.p50 >= 0.02
    assert measures.total_time(run) >= 0.25  # half a second at twice the pace
    assert run.pace == 2
    assert run.story_time(run.started + 0.2) == pytest.approx(0.4)
    profile = json.loads((tmp_path / "run" / PROFILES).read_text(encoding="utf-8"))["tasks"]["slam"]
    assert profile["inputs"]["stereo"]["done"] == done


def test_a_run_without_health_fails_and_is_not_kept(monkeypatch, tmp_path):
    timeline = tmp_path / "short.json"
    timeline.write_text(json.dumps(TIMELINE), encoding="utf-8")
    monkeypatch.setattr(run_module, "PATIENCE", 0.1)
    for name in ("start_robot", "stop_robot"):
        monkeypatch.setattr(installation, name, lambda *_: None)
    with router() as address:
        monkeypatch.setattr(installation, "session", lambda *_: client(address))
        with pytest.raises(deploy.DeployError, match="health within"):
            execute(Trial("exp3", 2.0, LINUX_DEFAULT, 0), timeline, tmp_path, tmp_path / "run")
    assert not (tmp_path / "run" / RUN).exists()


def test_each_task_alone_gets_its_own_inputs_one_after_the_other(tmp_path):
    path = tmp_path / "two.json"
    other = {"key": "robot/arm/order", "encoding": "json", "at": 0.1, "value": {"home": True}}
    path.write_text(json.dumps(TIMELINE | {"inputs": [*TIMELINE["inputs"], other]}), encoding="utf-8")
    source = TimelineSource(load(path), tmp_path)
    assert [sorted(part.encodings) for part in source.parts(alone=ALONE.alone)] == [
        ["robot/camera/stereo"],
        ["robot/arm/order"],
    ]
    (whole,) = source.parts(alone=LINUX_DEFAULT.alone)
    assert len(whole.encodings) == 2
