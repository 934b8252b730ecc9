import pytest

from tests.bench.enforcement.campaign import TRIES, quieter
from tests.bench.enforcement.figures import Run

SECONDS = 12.0
QUIET = 0.48
"""A fiftieth of two processors for as long."""


def tried(*foreign):
    """Which of these tries is kept, and how many were made."""
    runs = [Run({}, {}, None, foreign=seconds) for seconds in foreign]
    left = list(runs)
    kept = quieter(lambda: left.pop(0), SECONDS)
    return runs.index(kept), len(runs) - len(left)


def test_a_quiet_run_is_kept_at_once():
    assert tried(QUIET, 0.0) == (0, 1)


def test_a_run_beside_other_work_is_repeated():
    assert tried(0.49, 0.1, 0.0) == (1, 2)


@pytest.mark.parametrize(("foreign", "kept"), [((0.9, 0.6), 1), ((0.6, 0.9), 0)])
def test_quietest_run_is_kept_if_none_is_quiet(foreign, kept):
    assert tried(*foreign, 0.0) == (kept, TRIES)
