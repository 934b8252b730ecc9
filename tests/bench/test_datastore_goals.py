"""What is made of the figures of `tests.bench.datastore`."""

from __future__ import annotations

import os
import sqlite3

from tests.bench.datastore_goals import GOALS, LOADS, above, judged
from tests.bench.kine_rows import checkpoint

ROW = {
    "storm_agent": {"above_rest_mib_per_hour": 200.0},
    "minute_agent": {"above_rest_mib_per_hour": 30.1},
}


def test_each_goal_is_met_missed_or_left():
    storm, minute, own = judged(ROW)
    assert storm == "met     8 limits a second, with the agent: 200 MiB an hour above rest, the goal is 307.2"
    assert minute.startswith("missed  contexts once a minute, with the agent: 30.1 MiB")
    assert own.startswith("left")


def test_the_goals_need_no_other_loads():
    assert {goal.load for goal in GOALS} == set(LOADS) - {"rest"}


def test_idle_write_rate_is_subtracted():
    assert above({"datastore_mib_per_hour": 90.04}, {"datastore_mib_per_hour": 57.0}) == 33.0


def test_a_checkpoint_empties_the_log_and_reports_what_it_wrote(tmp_path):
    file = tmp_path / "state.db"
    with sqlite3.connect(file) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("CREATE TABLE kine (value BLOB)")
        database.execute("INSERT INTO kine VALUES (?)", (os.urandom(100_000),))
        database.commit()
        assert (tmp_path / "state.db-wal").stat().st_size > 100_000
        assert checkpoint(file) >= 0
        assert (tmp_path / "state.db-wal").stat().st_size == 0
        assert file.stat().st_size > 100_000
