import json

import pytest

from tests.bench.reaction.journal import Journal, OtherRunError

OPTIONS = {"rounds": 20}
STEPS = ["a", "b", "c"]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "bench" / "reaction.jsonl"


def test_what_was_measured_is_on_disk_before_the_next_step_fails(file):
    journal = Journal(file, OPTIONS, STEPS, resume=False)
    stages: dict[str, float] = {}
    journal.once("a", lambda: [1])
    with pytest.raises(KeyError):
        journal.once("b", lambda: stages["first patch accepted"])
    assert journal.left() == ["b", "c"]
    assert [json.loads(line) for line in file.read_text().splitlines()] == [OPTIONS, {"step": "a", "result": [1]}]


def test_a_run_that_goes_on_measures_only_what_is_left(file):
    Journal(file, OPTIONS, STEPS, resume=False).once("a", lambda: [1])
    journal = Journal(file, OPTIONS, STEPS, resume=True)
    assert journal.once("a", lambda: pytest.fail("measured twice")) == [1]
    assert journal.left() == ["b", "c"]
    assert (journal.found("a"), journal.found("b")) == ([1], [])


def test_a_line_that_was_half_written_is_measured_again(file):
    Journal(file, OPTIONS, STEPS, resume=False).once("a", lambda: [1])
    with file.open("a") as text:
        text.write('{"step": "b", "res')
    journal = Journal(file, OPTIONS, STEPS, resume=True)
    assert journal.left() == ["b", "c"]
    journal.once("b", lambda: [2])
    assert Journal(file, OPTIONS, STEPS, resume=True).left() == ["c"]


def test_a_run_with_other_options_is_not_gone_on_with(file):
    Journal(file, OPTIONS, STEPS, resume=False)
    with pytest.raises(OtherRunError, match=r'rounds": 20.*rounds": 30'):
        Journal(file, {"rounds": 30}, STEPS, resume=True)


def test_without_resume_everything_is_measured_anew(file):
    Journal(file, OPTIONS, STEPS, resume=False).once("a", lambda: [1])
    assert Journal(file, OPTIONS, STEPS, resume=False).left() == STEPS


def test_there_is_nothing_to_go_on_with(file):
    assert Journal(file, OPTIONS, STEPS, resume=True).left() == STEPS


def test_what_is_left_is_shown(file, capsys):
    journal = Journal(file, OPTIONS, STEPS, resume=False)
    journal.once("a", list)
    journal.once("b", list)
    assert [line.partition(" ")[2] for line in capsys.readouterr().err.splitlines()] == [
        "a; 3 of 3 steps left",
        "b; 2 of 3 steps left",
    ]
