"""Goals, judged by runs whose every time is known."""

from __future__ import annotations

import pytest

from tests.timelines.experiments.synthetic import fresh, write_run
from timelines.experiments import goals
from timelines.experiments.series import read_series


@pytest.fixture
def judged(tmp_path):
    """Verdicts by goal, of runs given as series, configuration, repeat and seconds that slam takes an input."""

    def found(*runs):
        for series, name, repeat, slam in runs:
            folder = fresh(tmp_path / series / name / str(repeat))
            write_run(folder, name, name, service={"slam": slam, "speech": 0.01}, pace=float(series[-1]))
        return {one.goal: one for one in goals.verdicts(read_series(tmp_path, tmp_path))}

    return found


SPEEDUP = "exp1 at 6 times the pace: total time at least 1.42 x as short as Linux default's"


def test_the_speedup_is_reported_with_what_is_possible(judged):
    found = judged(("exp1-x6", "linux-default", 0, 0.2), ("exp1-x6", "cfs-ca", 0, 0.1))
    assert found[SPEEDUP].met
    assert found[SPEEDUP].measured == "2 x; at most 2 x is possible"


def test_widely_varying_repeats_are_inconclusive(judged):
    runs = [("exp1-x6", name, repeat, slam) for repeat, pair in enumerate([(0.2, 0.1), (0.2, 0.19)])
            for name, slam in zip(("linux-default", "cfs-ca"), pair, strict=True)]  # fmt: skip
    assert judged(*runs)[SPEEDUP].met is None


def test_speedup_growth_is_judged_over_experiments(judged):
    found = judged(
        *[(f"{name}-x6", "linux-default", 0, 0.3) for name in ("exp1", "exp2", "exp3")],
        *[(f"{name}-x6", "cfs-ca", 0, slam) for name, slam in (("exp1", 0.1), ("exp2", 0.2), ("exp3", 0.15))],
    )
    growth = found["the speedup grows with length: exp1 > exp2 > exp3"]
    assert growth.met is False
    assert growth.measured == "not exp1 3 x > exp2 1.5 x > exp3 2 x"


def test_misses_count_at_real_pace_and_against_the_baseline(judged):
    runs = (("exp3-x1", "linux-default", 0, 0.2), ("exp3-x1", "cfs-ca", 0, 0.05))
    found = judged(*runs)
    tenth = found["exp3 at real pace: slam misses at most a tenth of Linux default's deadlines while the robot moves"]
    assert (tenth.measured, tenth.met) == ("0 % against 100 %", True)
    assert found["exp3 at real pace: and under 1 %"].met


def test_static_limits_must_be_beaten_on_misses_and_time(judged):
    found = judged(("exp3-x1", "static-limits", 0, 0.05), ("exp3-x1", "cfs-ca", 0, 0.2))
    both = found["exp3 at real pace: better than static limits on misses and on total time"]
    assert both.met is False
    assert both.measured == "100 points of misses, 0.5 x"


def test_response_time_is_judged_against_running_alone(judged):
    goal = "exp3 at real pace: slam answers within 1.15 x of what it takes alone, while the robot moves"
    alone = ("exp3-x1", "ideal", 0, 0.05)
    assert judged(alone, ("exp3-x1", "cfs-ca", 0, 0.05))[goal].met
    assert judged(alone, ("exp3-x1", "cfs-ca", 0, 0.09))[goal].measured == "1.8 x"
