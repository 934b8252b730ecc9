"""Rounds that miss a stage, or hear what belongs to the round before, on a machine that is too slow."""

import contextlib
import json
import signal
import sys
import time
from types import SimpleNamespace
from typing import Any

import pytest

from tests.bench import results
from tests.bench.reaction import __main__ as command
from tests.bench.reaction import priority, storm, transition
from tests.bench.reaction.figures import RESIZE, Figures, medians, rounded
from tests.bench.reaction.operated import Operated
from tests.bench.reaction.stopwatch import MissedError

BEGAN = 100.0
PLAN = {"edition": 0, "trigger": BEGAN + 0.001, "targets": [{"containerId": "a", "cores": 0.2}]}


class Group:
    """Stand in for a cgroup."""

    def limit(self):
        return 0.1


class Heard:
    """Stand in for the bus: these messages came after the round began."""

    def __init__(self, *messages):
        self.messages = messages

    def since(self, _moment):
        return [(BEGAN + 0.002, message) for message in self.messages]

    def wait(self, wanted, _since, _patience):
        found = [message for message in self.messages if wanted(message)]
        if not found:
            raise MissedError("not heard")
        return BEGAN + 0.002, found[0]

    def await_all(self, complete, _since, _patience):
        if not complete(list(self.messages)):
            raise MissedError("not heard")


@pytest.fixture
def path():
    """One container whose limit rises from 0.1 to 0.2 cores."""
    group = Group()
    made: Any = object.__new__(Operated)
    made._stopwatch = SimpleNamespace(wait=lambda *_: {group: BEGAN + 0.004})
    made._groups, made.turn = {"a": group}, lambda: BEGAN
    return made


def stages(at):
    return [{"stage": stage, "cores": 0.2, "time": at} for stage in ("accepted", "inForce")]


def test_every_stage_of_a_round_is_reported(path):
    path._plans, path._applied = Heard(PLAN), Heard(*stages(BEGAN + 0.003))
    assert path.go()["first patch accepted"] == pytest.approx(3)


def test_stages_from_before_the_round_are_ignored(path):
    path._plans, path._applied = Heard(PLAN), Heard(*stages(BEGAN - 0.5))
    with pytest.raises(MissedError):
        path.go()


def test_plan_of_an_earlier_sample_is_ignored(path):
    path._plans, path._applied = Heard({**PLAN, "trigger": BEGAN - 0.5}), Heard(*stages(BEGAN + 0.003))
    with pytest.raises(MissedError):
        path.go()


@pytest.mark.parametrize(("before", "samples"), [(False, [True]), (True, [False, True])])
def test_turn_forces_a_new_plan_from_either_state(path, before, samples):
    sent = []
    del path.turn
    path._left, path._plans = before, Heard({**PLAN, "targets": [{"task": "slam", "cores": 0.2}]})
    path._publisher = SimpleNamespace(put=lambda payload: sent.append(json.loads(payload)["left"]))
    path.await_limits = lambda _began: None
    assert path.turn_to(left=True) == {"slam": 0.2}
    assert sent == samples


def test_rounds_without_a_stage_leave_the_other_medians():
    reactions = [{"plan on the bus": 2.0}, {"plan on the bus": 4.0, "first patch accepted": 9.0}]
    assert medians(reactions, ["plan on the bus", "first patch accepted", "all cgroups"]) == {
        "plan on the bus ms p50": 3.0,
        "first patch accepted ms p50": 9.0,
        "all cgroups ms p50": None,
    }
    assert rounded([], 50) is None


def test_missed_reactions_are_counted_and_the_others_stay():
    figures = Figures()
    figures.note("idle", 8, [{"path": "p", "stages": {"cgroup": 5.0}}, {"path": "p", "missed": "2 of 8 limits"}])
    assert figures.rows()[0]["n"] == 1
    assert figures.missed == ["idle, 8 pods, p: 2 of 8 limits"]


def test_a_round_before_which_the_critical_task_had_its_limit_is_missed():
    group = Group()
    case: Any = object.__new__(transition._Case)
    case._groups, case._stopwatch = {transition.CRITICAL: group}, SimpleNamespace(forget=lambda: None)
    reaction = case._reaction("Prompt", lambda: case._reaction_of(BEGAN, {group: 0.2}, {group: 0.2}, None))
    assert "missed" in reaction


def miss():
    raise MissedError("slow")


@pytest.fixture
def slow():
    """A path whose every round is missed."""
    return SimpleNamespace(name="operator, resize", go=miss)


@pytest.fixture
def site(monkeypatch):
    """Nothing is waited for."""
    monkeypatch.setattr(time, "sleep", lambda _seconds: None)
    return SimpleNamespace(quiet=SimpleNamespace(wait=lambda: None), saturate=lambda **_: None)


def test_row_is_written_if_every_round_was_missed(site, slow, monkeypatch):
    clock = iter(range(1000))
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    row = priority._saturated(site, slow)
    assert (row["n"], row["first patch accepted ms p50"]) == (0, None)
    assert row["missed"] > 0


def test_row_is_written_if_every_storm_was_missed(site, slow):
    row = storm._storms(site, slow, slow)
    assert (row["n"], row["missed"], row["after_storm_ms_p50"]) == (0, storm.STORMS, None)


def test_figures_are_written_if_the_run_fails(monkeypatch, tmp_path):
    def measure(_options, journal, _problems):
        journal.once("control: Limit", lambda: [{"control": "Limit"}])
        raise KeyError("first patch accepted")

    for module in (command, results):
        monkeypatch.setattr(module, "OUTPUT", tmp_path)
    monkeypatch.setattr(command, "_measure", measure)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["reaction", "--only", "control"])
    with contextlib.suppress(KeyError):
        command.main()
    written = (tmp_path / "reaction-control.json").read_text()
    assert '"control": "Limit"' in written
    assert '"control: Weight"' in written


def test_peers_are_compared_within_each_round():
    figures = Figures()
    for ours, other in ((10.0, 20.0), (100.0, 300.0), (5.0, 10.0)):
        figures.note("idle", 1, [{"path": RESIZE, "stages": {"first cgroup": ours}}])
        figures.note("idle", 1, [{"path": "docker update", "stages": {"cgroup": other}}])
    [own, docker] = figures.peers()
    assert (own["over_operator"], own["interval"]) == (1.0, "1.000 to 1.000")
    assert (docker["p50_ms"], docker["over_operator"], docker["n"]) == (20.0, 2.0, 3)


def test_a_round_that_one_of_a_pair_missed_does_not_count():
    figures = Figures()
    figures.note("idle", 1, [{"path": RESIZE, "missed": "slow"}, {"path": "docker update", "stages": {"cgroup": 9.0}}])
    figures.note("idle", 1, [{"path": RESIZE, "stages": {"first cgroup": 3.0}}])
    figures.note("idle", 1, [{"path": "docker update", "stages": {"cgroup": 6.0}}])
    assert [row["n"] for row in figures.peers()] == [1, 1]
    assert figures.peers()[1]["over_operator"] == 2.0
