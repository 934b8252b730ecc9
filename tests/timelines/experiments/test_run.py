"""One short run without a node: a real bus, a real module, and the recording that the measures read."""

from __future__ import annotations

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import pytest

from contextpolicy.streams.timeline import load
from robotkit import Input, Module, Needs, Task
from robotkit.runner import Runner
from tests.modules.robotkit.bus import client, router
from tests.timelines.experiments.made_up import ABOUT, a_run, at_speed
from timelines.demo import cgroup, deploy
from timelines.experiments import collect, confine, earlier, healths, installation, metrics, workbench
from timelines.experiments import run as run_module
from timelines.experiments.accounting import Ending
from timelines.experiments.blocks import HEAVY, UNSLOWED, Trial
from timelines.experiments.calm import DisturbedError
from timelines.experiments.capacity import WHOLE, Capacity
from timelines.experiments.configurations import ALONE, LINUX, REALTIME, STATIC, WEIGHTS, WEIGHTS_AT_ONCE
from timelines.experiments.cpu_account import SLOWING
from timelines.experiments.due import Schedule, Window
from timelines.experiments.raw_data import RUN, read_run
from timelines.experiments.record import RecordError
from timelines.experiments.run import Conditions, TimelineSource, execute
from timelines.experiments.slowed import Pace, SlowedError
from timelines.experiments.stories import HELD_OUT

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


TRIAL = Trial(HEAVY, HELD_OUT[0], LINUX, 0, 0)
STEREO = "robot/camera/stereo"
SCHEDULE = Schedule(
    0.5, {STEREO: [n / 20 for n in range(10)]}, {"slam": {"stereo": STEREO}}, {"slam": 0.1},
    [Window(0.0, 0.5, ("drive",), frozenset())],
)  # fmt: skip


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
        monkeypatch.setattr(run_module, "tasks_of", lambda _: ("slam",))
        monkeypatch.setattr(installation, "start_robot", lambda *_: None)
        monkeypatch.setattr(installation, "stop_robot", lambda: None)
        monkeypatch.setattr(installation, "decide", lambda *_: None)
        monkeypatch.setattr(installation, "cgroups", lambda _: {})
        monkeypatch.setattr(run_module, "wait_until_calm", lambda: 0.1)
        monkeypatch.setattr(run_module, "as_service", lambda _: nullcontext())
        monkeypatch.setattr(run_module, "slowed", at_pace)
        monkeypatch.setattr(confine, "punctual", nullcontext)
        monkeypatch.setattr(installation, "session", lambda *_: client(address))
        running = pool.submit(Runner(inside, SLAM, Busy(), shared_memory=False).run, stop, keep_runs=True)
        yield
        stop.set()
        running.result()


@contextmanager
def at_pace(pace, _):
    """In place of slowed processors, which a busy machine does not have."""

    class Thieves:
        def seconds(self):
            return 0.0

        def pace(self):
            return Pace(pace, 1.0, 1.0)

    yield Thieves()


def conditions(tmp_path):
    timeline = tmp_path / "short.json"
    timeline.write_text(json.dumps(TIMELINE), encoding="utf-8")
    return Conditions(timeline, tmp_path, Capacity(1, 1.0), WHOLE, 1.8 * WHOLE, {}, "abc1234")


def test_every_input_of_a_run_is_accounted_for(node, tmp_path):  # noqa: ARG001
    execute(TRIAL, conditions(tmp_path), tmp_path / "run")
    kept = collect.record(TRIAL, read_run(tmp_path / "run"), SCHEDULE, {})
    tally = metrics.Run(SCHEDULE, kept).tally("slam", "drive")
    assert tally.due == 10
    assert tally.count(Ending.IN_TIME, Ending.LATE, Ending.DROPPED, Ending.LOST) == 10
    assert tally.coverage > 0  # a busy machine's bus may drop one
    assert all(response >= 200 for response in kept.columns["slam"]["stereo"].responses)  # it takes 20 ms
    assert kept.about["drained"]
    assert kept.about["finished"] > 0
    assert kept.about["code"] == "abc1234"
    assert kept.about["expected"] == round(1.8 * WHOLE)
    assert "weights" not in kept.about


def test_limits_are_of_the_speed_that_is_expected_of_a_processor(node, monkeypatch, tmp_path):  # noqa: ARG001
    told: list[float] = []
    monkeypatch.setattr(installation, "decide", lambda _, __, there, ___: told.append(there))
    execute(TRIAL, conditions(tmp_path), tmp_path / "run")
    assert told == [pytest.approx(1.8)]


def test_the_player_is_punctual(node, monkeypatch, tmp_path):  # noqa: ARG001
    punctual = Mock(side_effect=nullcontext)
    monkeypatch.setattr(confine, "punctual", punctual)
    execute(TRIAL, conditions(tmp_path), tmp_path / "run")
    punctual.assert_called_once_with()


def test_realtime_runs_on_processors_as_they_are(node, monkeypatch, tmp_path):  # noqa: ARG001
    """What slows them, and a player of realtime priority, would compete with its tasks."""
    monkeypatch.setattr(run_module, "speed", lambda _: 2 * WHOLE)
    monkeypatch.setattr(run_module, "slowed", None)
    monkeypatch.setattr(confine, "punctual", None)
    execute(TRIAL._replace(load=UNSLOWED, configuration=REALTIME), conditions(tmp_path), tmp_path / "run")
    about = read_run(tmp_path / "run").about["about"]
    assert about["pace"] == {"speed": 2 * WHOLE, "left": 1.0, "worst": 1.0}
    assert about["cpu"][SLOWING] == 0


def test_a_run_with_static_weights_has_them(node, tmp_path):  # noqa: ARG001
    static = TRIAL._replace(configuration=STATIC)
    execute(static, replace(conditions(tmp_path), weights={"slam": 7}), tmp_path / "run")
    assert read_run(tmp_path / "run").about["about"]["weights"] == {"slam": 7}


def test_a_run_of_a_silent_robot_fails_and_leaves_nothing_to_resume(monkeypatch, tmp_path):
    monkeypatch.setattr(healths, "PATIENCE", 0.1)
    monkeypatch.setattr(run_module, "wait_until_calm", lambda: 0.1)
    for name in ("start_robot", "stop_robot"):
        monkeypatch.setattr(installation, name, lambda *_: None)
    with router() as address:
        monkeypatch.setattr(installation, "session", lambda *_: client(address))
        with pytest.raises(deploy.DeployError, match="health within"):
            execute(TRIAL, conditions(tmp_path), tmp_path / "run")
    assert not (tmp_path / "run" / RUN).exists()


class Forgetful:
    """A bus that loses the first answers of the IMU."""

    def __init__(self, lost):
        self.asked, self._lost = 0, lost

    def get(self, keys, timeout):  # noqa: ARG002 - as Zenoh calls it
        self.asked += 1
        for task in ("slam", "imu"):
            if task == "slam" or self.asked > self._lost:
                payload = SimpleNamespace(to_bytes=lambda: b"{}")
                yield SimpleNamespace(ok=SimpleNamespace(key_expr=keys.replace("*", task), payload=payload))


def test_a_task_whose_answer_is_lost_is_asked_again():
    bus: Any = Forgetful(2)
    assert run_module.answers(bus, run_module.RUNS, ("slam", "imu")).keys() == {"robot/slam/runs", "robot/imu/runs"}
    assert bus.asked == 3
    with pytest.raises(deploy.DeployError, match=r"no answer on robot/\*/runs received from imu"):
        run_module.answers(cast("Any", Forgetful(3)), run_module.RUNS, ("slam", "imu"))


def test_each_task_alone_gets_its_own_inputs_one_after_the_other(tmp_path):
    path = tmp_path / "two.json"
    other = {"key": "robot/arm/order", "encoding": "json", "at": 0.1, "value": {"home": True}}
    path.write_text(json.dumps(TIMELINE | {"inputs": [*TIMELINE["inputs"], other]}), encoding="utf-8")
    source = TimelineSource(load(path), tmp_path, ("slam", "arm"))
    assert [sorted(part.encodings) for part in source.parts(alone=ALONE.alone)] == [
        ["robot/camera/stereo"],
        ["robot/arm/order"],
    ]
    (whole,) = source.parts(alone=LINUX.alone)
    assert len(whole.encodings) == 2


class Flaky:
    """A node on which the first runs fail, and of whose recordings the first can't be understood."""

    def __init__(self, monkeypatch, *, fails=0, muddled=0, error=deploy.DeployError):
        self.installed, self.runs, self.fails, self.muddled, self.error = 0, 0, fails, muddled, error
        self.expected: list[float] = []
        monkeypatch.setattr(installation, "stop_robot", lambda: None)
        monkeypatch.setattr(installation, "install", self.install)
        monkeypatch.setattr(workbench, "execute", self.execute)
        monkeypatch.setattr(workbench.Workbench, "schedule", lambda *_: SCHEDULE)
        monkeypatch.setattr(workbench.Workbench, "_understood", self.understood)

    def install(self, _):
        self.installed += 1

    def execute(self, _, conditions, folder):
        self.runs += 1
        self.expected.append(conditions.expected)
        if self.runs <= self.fails:
            raise self.error("helm: timed out")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / RUN).write_text("{}", encoding="utf-8")

    def understood(self, *_):
        self.muddled -= 1
        if self.muddled >= 0:
            raise ValueError("half a message")
        return at_speed(a_run("linux"), 1.5)


def play(tmp_path):
    bench = workbench.Workbench(workbench.Folders(*[tmp_path] * 4))
    return bench.record("2-heavy-01", TRIAL, workbench.Setting(Capacity(1, 0.4), {}), {})


@pytest.mark.parametrize("error", [deploy.DeployError, OSError])
def test_a_run_that_fails_is_done_again_on_a_new_installation(monkeypatch, tmp_path, error):
    node = Flaky(monkeypatch, fails=2, error=error)
    assert play(tmp_path).about["failures"] == [f"{error.__name__}: helm: timed out"] * 2
    assert (node.runs, node.installed) == (3, 3)


def test_a_run_that_can_not_be_understood_is_played_again(monkeypatch, tmp_path):
    node = Flaky(monkeypatch, muddled=1)
    assert play(tmp_path).about["failures"] == ["ValueError: half a message"]
    assert node.runs == 2


def test_an_attempt_that_does_not_count_is_kept_and_repeated(monkeypatch, tmp_path):
    late = replace(a_run("linux"), late={"robot/camera/stereo": [9000] * 10})
    node, found = Flaky(monkeypatch), iter([late, a_run("linux")])
    monkeypatch.setattr(workbench.Workbench, "_understood", lambda *_: next(found))
    assert len(play(tmp_path).about["failures"]) == 1
    assert node.runs == 2
    (kept,) = workbench.Workbench(workbench.Folders(*[tmp_path] * 4)).rejected("2-heavy-01", TRIAL)
    assert kept.late == late.late
    assert kept.about["failures"] == ["100 % of the inputs were published more than 0.2 s late: expected at most 1 %"]


def test_a_run_does_not_count_where_the_code_changed_meanwhile(monkeypatch, tmp_path):
    """Policies, charts and what slows the processors are read anew for each run."""
    versions = iter(("1a2b3c4", "1a2b3c4 and changes", "5d6e7f8", "5d6e7f8"))
    node = Flaky(monkeypatch)
    monkeypatch.setattr(workbench, "code_version", lambda _: next(versions))
    with pytest.raises(RecordError, match=r"the code is not 1a2b3c4 any more: change nothing, and run it again"):
        play(tmp_path)
    assert not list(tmp_path.rglob("*.xz"))
    play(tmp_path)
    assert node.runs == 2


def test_a_run_is_expected_to_be_as_fast_as_the_one_before(monkeypatch, tmp_path):
    node, bench = Flaky(monkeypatch), workbench.Workbench(workbench.Folders(*[tmp_path] * 4))
    monkeypatch.setattr(earlier, "this_machine", lambda: ABOUT["machine"])
    for place in ("2-heavy-01", "2-heavy-02"):
        bench.record(place, TRIAL, workbench.Setting(Capacity(1, 0.4), {}), {})
    assert node.expected == [WHOLE, 1.5 * WHOLE]


def test_a_run_of_an_earlier_call_is_compared_with_as_well(monkeypatch, tmp_path):
    node, setting = Flaky(monkeypatch), workbench.Setting(Capacity(1, 0.4), {})
    monkeypatch.setattr(earlier, "this_machine", lambda: ABOUT["machine"])
    play(tmp_path)
    bench = workbench.Workbench(workbench.Folders(*[tmp_path] * 4))
    for place in ("2-heavy-01", "2-heavy-01", "2-heavy-02"):
        bench.record(place, TRIAL, setting, {})
    assert node.expected == [WHOLE, 1.5 * WHOLE]
    assert sum(len(speeds) for speeds in bench._earlier._speeds.values()) == 2


def test_a_run_that_was_played_before_it_was_interrupted_is_only_read(monkeypatch, tmp_path):
    node = Flaky(monkeypatch)
    node.execute(None, conditions(tmp_path), tmp_path / "runs" / "2-heavy-01" / TRIAL.name)
    play(tmp_path)
    assert node.runs == 1


def test_a_node_that_always_fails_ends_the_runs_and_they_are_played_again_next_time(monkeypatch, tmp_path):
    for trouble in ({"fails": 99}, {"muddled": 99}):
        node = Flaky(monkeypatch, **trouble)
        with pytest.raises(deploy.DeployError, match="failed 3 times, at last"):
            play(tmp_path)
        assert node.runs == workbench.TRIES
    assert not list(tmp_path.rglob(RUN))


def test_a_run_that_the_machine_disturbs_is_repeated_more_often(monkeypatch, tmp_path):
    node = Flaky(monkeypatch, fails=workbench.DISTURBED - 1, error=DisturbedError)
    assert len(play(tmp_path).about["failures"]) == workbench.DISTURBED - 1
    node = Flaky(monkeypatch, fails=99, error=SlowedError)
    with pytest.raises(deploy.DeployError, match=f"failed {workbench.DISTURBED} times, at last"):
        play(tmp_path / "again")
    assert node.runs == workbench.DISTURBED


def test_the_bus_is_the_same_with_and_without_the_agent(monkeypatch):
    said: list[tuple[str, ...]] = []

    def run(*words, **_):
        said.append(words)
        return ""

    monkeypatch.setattr(deploy, "_pod_logs", lambda: "/var/log/pods")
    monkeypatch.setattr(deploy, "free_address", lambda: "10.43.7.47")
    monkeypatch.setattr(deploy, "run", run)
    for configuration in (LINUX, WEIGHTS):
        installation.install(configuration)
    without, with_agent = ({word for word in words if "=" in word} for words in said if words[0] == "helm")
    assert "security.namespaces={robot}" in without
    assert with_agent - without == {"agent.enabled=true", "agent.podLogs=/var/log/pods"}
    assert without <= with_agent
    installation.install(WEIGHTS_AT_ONCE)
    assert {word for word in said[-1] if "=" in word} - with_agent == {"agent.settleSeconds=2"}
    installation.install(REALTIME)
    assert {word for word in said[-1] if "=" in word} - with_agent == {"agent.realtime=true"}


def test_a_policy_that_stays_ends_the_run(monkeypatch):
    def run(*words, quiet=False):
        if words[:2] == ("kubectl", "delete") and not quiet:
            raise deploy.DeployError("timed out")
        return "there"

    monkeypatch.setattr(deploy, "run", run)
    with pytest.raises(deploy.DeployError):
        installation.stop_robot()


def test_a_container_that_is_ending_is_none_of_the_controls(monkeypatch):
    """The agent of the configuration before: it is gone before the run ends."""

    def pod(name, **metadata):
        status = {"name": name, "containerID": f"containerd://{name}", "state": {"running": {}}}
        return {"metadata": metadata, "status": {"containerStatuses": [status]}}

    pods = {"items": [pod("operator"), pod("agent", deletionTimestamp="2026-11-27T20:00:00Z")]}
    monkeypatch.setattr(deploy, "run", lambda *_, **__: json.dumps(pods))
    monkeypatch.setattr(deploy, "containers", lambda _: {"slam": "containerd://slam"})
    monkeypatch.setattr(cgroup, "find", lambda identity: identity)
    assert installation.cgroups(["slam"]).keys() == {"slam", "operator"}
