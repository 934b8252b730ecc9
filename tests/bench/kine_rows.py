"""What kine's rows are about, and how much of what SQLite writes is due to each kind.

Each write of an object is a row with the object and the one before it, and kine drops rows after some minutes. A tally
therefore looks every few seconds. Of one row SQLite writes 44 KiB, whatever it holds (seven indexes and the log), and
4.1 times its object (`value`): measured with 1500 rows each of 0.5 to 20 KB, in a database of 3000, a transaction for
each, checkpoints included. An Event's end, an hour later, is another row, which no stretch of minutes has.
"""

from __future__ import annotations

import os
import sqlite3
import threading
from collections import Counter
from contextlib import closing
from typing import TYPE_CHECKING, Self

from tests.bench.footprint.processes import written

if TYPE_CHECKING:
    from pathlib import Path

ROW, PER_BYTE = 44 * 1024, 4.1
LOOK = 5.0
"""Seconds between two looks; kine keeps the newest 1000 rows longer than that."""
KINDS = ("status", "policy_events", "pods", "pod_events", "leases", "other")
OWN, ALL = KINDS[:2], KINDS[:4]
_NEW = "SELECT id, name, length(value) FROM kine WHERE id > ? ORDER BY id"


def open_database(path: Path) -> sqlite3.Connection:
    """kine's database, to be read while kine writes it."""
    return sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=10, check_same_thread=False)


def checkpoint(path: Path) -> int:
    """Have all that is only in SQLite's log written to the database; the bytes that this took.

    kine does so after each 4 MiB of log, which is as much as a calm robot writes in minutes: between two checkpoints of
    ours, what kine and we wrote is what the load cost, whenever its own ones came.
    """
    before = written(os.getpid())
    with closing(sqlite3.connect(path, timeout=10)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
    return written(os.getpid()) - before


class Tally:
    """Counts what is written while it is entered."""

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database
        (newest,) = database.execute("SELECT max(id) FROM kine").fetchone()
        self._newest = int(newest or 0)
        self._rows: list[tuple[str, int]] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="kine-rows")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.look()
        self._database.close()

    def look(self) -> None:
        """Take the rows that are new."""
        for number, name, size in self._database.execute(_NEW, (self._newest,)).fetchall():
            self._newest = number
            self._rows.append((name, size or 0))

    def figures(self, policy: str) -> dict[str, float]:
        """Rows and estimated MiB by kind; `policy` is the name of the policies whose Events are ours."""
        rows: Counter[str] = Counter()
        written: Counter[str] = Counter()
        for name, size in self._rows:
            rows[kind := kind_of(name, policy)] += 1
            written[kind] += round(ROW + PER_BYTE * size)
        both = sum(written[kind] for kind in ALL)
        return {
            **{f"{kind}_rows": rows[kind] for kind in KINDS},
            **{f"{kind}_mib": round(written[kind] / 2**20, 2) for kind in KINDS},
            "own_share_percent": round(100 * sum(written[kind] for kind in OWN) / both, 1) if both else 0.0,
        }

    def _run(self) -> None:
        while not self._ended.wait(LOOK):
            self.look()


def kind_of(name: str, policy: str) -> str:
    """What a row is about; `name` is the key under which the API server stores an object."""
    what, _, rest = name.removeprefix("/registry/").partition("/")
    if what == "events":
        return "policy_events" if rest.partition("/")[2].startswith(f"{policy}.") else "pod_events"
    return {"contextpolicy.dev": "status", "pods": "pods", "leases": "leases"}.get(what, "other")
