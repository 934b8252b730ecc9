"""What is run, in which order, and what the next run may take."""

from __future__ import annotations

from pathlib import Path

from timelines.experiments.configurations import ALL, IDEAL, LINUX_DEFAULT
from timelines.experiments.trials import EXPERIMENTS, START, longest, trials


def test_every_series_has_the_baseline_and_every_configuration_runs_somewhere():
    series = [own for paces in EXPERIMENTS.values() for own in paces.values()]
    assert all(LINUX_DEFAULT in own for own in series)
    assert {one.name for own in series for one in own} == {one.name for one in ALL}


def test_repeats_are_interleaved_over_configurations_and_paces():
    found = [str(one) for one in trials(["exp3"], 2, only=["linux-default", "cfs-ca"])]
    once = [
        "exp3-x1 Linux default, repeat {}",
        "exp3-x6 Linux default, repeat {}",
        "exp3-x1 CFS CA, repeat {}",
        "exp3-x6 CFS CA, repeat {}",
    ]
    assert found == [line.format(repeat) for repeat in (0, 1) for line in once]


def test_the_ideal_is_run_once_and_what_the_node_cannot_do_never():
    found = list(trials(["exp3"], 3, can=lambda one: not one.realtime))
    assert sum(one.configuration.name == IDEAL for one in found) == 1
    assert not any(one.configuration.realtime for one in found)


def test_raw_data_lies_by_series_configuration_and_repeat():
    (first, *_) = trials(["exp2"], 1, paces=[6.0])
    assert first.folder(Path("out")) == Path("out/exp2-x6/linux-default/0")


def test_the_next_run_takes_what_the_longest_took():
    assert longest([40.0, 55.0, 50.0], 15.0, 1.0) == 55
    assert longest([], 15.0, 2.0) == 15 + START
