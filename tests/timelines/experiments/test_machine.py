"""What counts as a whole processor on a machine where the tasks gain less than a small loop does."""

from __future__ import annotations

from dataclasses import replace

import pytest
import yaml

from tests.timelines.experiments.made_up import SCHEDULE, a_run, at_speed
from timelines.demo import deploy
from timelines.experiments import installation
from timelines.experiments.blocks import HEAVY, Trial
from timelines.experiments.calm import DisturbedError
from timelines.experiments.capacity import WHOLE, Capacity, in_cpu_time
from timelines.experiments.configurations import LIMITS, WEIGHTS
from timelines.experiments.installation import policy_document
from timelines.experiments.machine import ENOUGH, whole_here
from timelines.experiments.metrics import Run
from timelines.experiments.stories import HELD_OUT

REFERENCE = Run(SCHEDULE, at_speed(a_run("alone", cpu=0.02), 1.44))


def machine(loop, cpu):
    """A machine whose loop does so many times WHOLE turns a second, where an input takes so much CPU."""
    played = []

    def play(whole):
        played.append(whole)
        record = at_speed(a_run("alone", cpu=cpu), loop)
        return Run(SCHEDULE, replace(record, about={**record.about, "whole": whole}))

    return play, played


def test_where_the_loop_gains_more_than_the_tasks_a_whole_processor_is_more_turns():
    """As measured: a loop 1.54 times as fast as during calibration, and inputs of 0.81 times the CPU time."""
    play, played = machine(1.44 * 1.54, 0.02 * 0.81)
    assert whole_here(REFERENCE, [], play) == pytest.approx(1.247 * WHOLE, rel=0.01)
    assert played[0] == WHOLE
    assert len(played) == 1 + ENOUGH  # the first was too far off to show more than where to look


def test_one_run_that_is_a_little_off_does_not_move_it():
    costs = iter([0.02, 0.0208, 0.0199])
    assert whole_here(REFERENCE, [], lambda whole: machine(1.44, next(costs))[0](whole)) == WHOLE  # noqa: PLW0108 - a new cost each time


def test_where_enough_runs_have_shown_it_nothing_is_played():
    known = [machine(1.44, cost)[0](WHOLE) for cost in (0.0199, 0.02, 0.0203, 0.04)]
    assert whole_here(REFERENCE, known, lambda _: pytest.fail("it was played")) == WHOLE


def test_a_machine_that_changes_from_run_to_run_is_not_measured_on():
    costs = iter([0.02, 0.03] * 9)

    def play(whole):
        return machine(1.0, next(costs))[0](whole)

    with pytest.raises(DisturbedError, match="of the calibration's work: expected 3 runs of about 100%"):
        whole_here(REFERENCE, [], play)


def test_a_policy_divides_cpu_time_of_which_a_fast_machine_has_less_for_the_same_work():
    """Without it the bounds of a policy add up to more than what is left, and no limit is one."""
    one, half = (Capacity(1, 0.985).reserve(2, speed) for speed in (1.0, 2.0))
    assert (one, half) == ("1020m", "1510m")
    slow, fast = (in_cpu_time(policy_document(HELD_OUT[0]), speed)["spec"]["tasks"] for speed in (1.0, 2.0))
    assert {one["name"]: one.get("min") for one in slow}["imu"] == "250m"
    assert {one["name"]: one.get("min") for one in fast}["imu"] == "125m"


@pytest.mark.parametrize(("configuration", "least"), [(LIMITS, "125m"), (WEIGHTS, "250m")])
def test_only_limits_are_cpu_time(monkeypatch, tmp_path, configuration, least):
    monkeypatch.setattr(deploy, "run", lambda *_, **__: "")
    installation.decide(Trial(HEAVY, HELD_OUT[0], configuration, 0, 0), Capacity(1, 0.89), 2.0, tmp_path)
    applied = yaml.safe_load((tmp_path / "policy.yaml").read_text(encoding="utf-8"))["spec"]["tasks"]
    assert {one["name"]: one.get("min") for one in applied}["imu"] == least
