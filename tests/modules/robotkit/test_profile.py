from __future__ import annotations

from typing import Any

import pytest

from robotkit import Input, Module, Needs
from robotkit.profile import Profile, Record, Run, distribution

MS = 1_000_000
NOW = 1_700_000_000_000_000_000


def a_run(*, stamp=0, finished=50):
    return Run(NOW + stamp * MS, NOW + MS, NOW + 2 * MS, NOW + finished * MS, 20 * MS)


def test_a_run_that_ends_after_the_deadline_is_a_miss():
    record = Record(0.1)
    assert [record.add(a_run(finished=at)) for at in (99, 100, 101)] == [False, False, True]
    assert (record.done, record.missed) == (3, 1)


def test_without_a_deadline_nothing_is_missed():
    assert not Record(None).add(a_run(finished=10**9))


@pytest.mark.parametrize(("stamp", "latency_ms"), [(0, 50), (1, 49), (2, 49), (-70_000, 49)])
def test_lateness_counts_from_the_source_unless_its_clock_is_another(stamp, latency_ms):
    assert a_run(stamp=stamp).latency == latency_ms * MS


def test_a_distribution_can_be_drawn_from():
    reported = distribution(range(0, 201 * MS, MS))
    assert (reported["mean"], reported["std"]) == (pytest.approx(0.1), pytest.approx(0.058023, abs=1e-6))
    assert reported["quantiles"] == pytest.approx([step / 100 for step in range(21)])


def test_the_document_has_every_input_and_what_was_dropped():
    profile = Profile(Module("slam", inputs={"stereo": Input("robot/camera/stereo")}, needs=Needs(deadline=0.1)))
    profile.inputs["stereo"].add(a_run())
    document = profile.as_json("front-slam", {"stereo": 4}, {"stereo": 1})
    assert (document["task"], document["module"]) == ("front-slam", "slam")
    inputs: Any = document["inputs"]
    stereo = inputs["stereo"]
    assert (stereo["done"], stereo["dropped"], stereo["shared"]) == (1, 4, 1)
    assert [stereo[name]["mean"] for name in ("cpu", "wait", "service", "latency")] == [0.02, 0.001, 0.048, 0.05]
