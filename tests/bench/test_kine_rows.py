from __future__ import annotations

import sqlite3

import pytest

from tests.bench import kine_rows
from tests.bench.kine_rows import PER_BYTE, ROW, Tally, kind_of


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("/registry/contextpolicy.dev/contextpolicies/lab/bench", "status"),
        ("/registry/events/lab/bench.0a1b2c", "policy_events"),
        ("/registry/events/lab/bench-0.0a1b2c", "pod_events"),
        ("/registry/pods/lab/bench", "pods"),
        ("/registry/leases/kube-node-lease/node", "leases"),
        ("compact_rev_key", "other"),
    ],
)
def test_a_row_is_of_one_kind(name, kind):
    assert kind_of(name, "bench") == kind


@pytest.fixture
def database(tmp_path):
    """One that kine writes."""
    path = tmp_path / "state.db"
    with sqlite3.connect(path) as made:
        made.execute("CREATE TABLE kine (id INTEGER PRIMARY KEY, name TEXT, value BLOB)")
        put(made, "/registry/pods/lab/before", 5000)
        made.commit()
        yield path, made


def put(database, name, size):
    database.execute("INSERT INTO kine (name, value) VALUES (?, ?)", (name, bytes(size)))
    database.commit()


def test_only_rows_written_meanwhile_count_once(database):
    path, made = database
    with Tally(kine_rows.open_database(path)) as tally:
        put(made, "/registry/pods/lab/slam", 5000)
        tally.look()
        put(made, "/registry/pods/lab/slam", 5000)
        put(made, "/registry/contextpolicy.dev/contextpolicies/lab/bench", 8000)
        put(made, "/registry/leases/kube-system/lease", 500)
    found = tally.figures("bench")
    assert (found["pods_rows"], found["status_rows"], found["leases_rows"], found["other_rows"]) == (2, 1, 1, 0)
    pods, status = 2 * (ROW + PER_BYTE * 5000), ROW + PER_BYTE * 8000
    assert found["pods_mib"] == pytest.approx(pods / 2**20, abs=0.01)
    assert found["own_share_percent"] == pytest.approx(100 * status / (pods + status), abs=0.1)


def test_a_deleted_object_has_no_value(database):
    path, made = database
    with Tally(kine_rows.open_database(path)) as tally:
        made.execute("INSERT INTO kine (name) VALUES ('/registry/pods/lab/slam')")
        made.commit()
    assert tally.figures("bench")["pods_mib"] == round(ROW / 2**20, 2)


def test_own_share_is_zero_without_writes(database):
    path, _ = database
    with Tally(kine_rows.open_database(path)) as tally:
        pass
    assert tally.figures("bench")["own_share_percent"] == 0
