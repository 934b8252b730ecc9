import json

import pytest

from tests.bench.reaction.journal import Journal

OPTIONS = {"rounds": 20}
STEPS = ["a", "b", "c"]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "bench" / "reaction.jsonl"


def test_finished_steps_are_on_disk_when_a_later_one_fails(file):
    journal = Journal(file, OPTIONS, STEPS, resume=False)
    stages: dict[str, float] = {}
    journal.once("a", lambda: [1])
    with pytest.raises(KeyError):
        journal.once("b", lambda: stages["first patch accepted"])
    assert journal.left() == ["b", "c"]
    assert [json.loads(line) for line in file.read_text().splitlines()] == [OPTIONS, {"step": "a", "result": [1]}]


def test_resumed_run_measures_only_remaining_steps(file):
    Journal(file, OPTIONS, STEPS, resume=False).once("a", lambda: [1])
    journal = Journal(file, OPTIONS, STEPS, resume=True)
    assert journal.once("a", lambda: pytest.fail("measured twice")) == [1]
    assert journal.left() == ["b", "c"]
    assert (journal.found("a"), journal.found("b")) == ([1], [])


def test_remaining_steps_are_shown(file, capsys):
    journal = Journal(file, OPTIONS, STEPS, resume=False)
    journal.once("a", list)
    journal.once("b", list)
    assert [line.partition(" ")[2] for line in capsys.readouterr().err.splitlines()] == [
        "a; 3 of 3 steps left",
        "b; 2 of 3 steps left",
    ]
