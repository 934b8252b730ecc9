import json

import pytest

from tests.bench.json_lines import JsonLines, OtherRunError

OPTIONS = {"rounds": 20}


@pytest.fixture
def file(tmp_path):
    return tmp_path / "bench" / "run.jsonl"


def test_added_lines_are_flushed_and_resumed(file):
    JsonLines(file, OPTIONS, resume=False).add({"step": "a"})
    assert [json.loads(line) for line in file.read_text().splitlines()] == [OPTIONS, {"step": "a"}]
    assert JsonLines(file, OPTIONS, resume=True).found == [{"step": "a"}]


def test_a_line_that_was_cut_off_is_left_out_and_the_file_stays_readable(file):
    JsonLines(file, OPTIONS, resume=False).add({"step": "a"})
    with file.open("a") as text:
        text.write('{"step": "b", "res')
    again = JsonLines(file, OPTIONS, resume=True)
    assert again.found == [{"step": "a"}]
    again.add({"step": "c"})
    assert JsonLines(file, OPTIONS, resume=True).found == [{"step": "a"}, {"step": "c"}]


def test_reading_a_file_that_is_being_written_leaves_it_as_it_is(file):
    JsonLines(file, OPTIONS, resume=False).add({"step": "a"})
    with file.open("a") as text:
        text.write('{"step": "b", "res')
    before = file.read_text()
    assert JsonLines(file, OPTIONS, resume=True).found == [{"step": "a"}]
    assert file.read_text() == before


def test_run_with_other_options_is_not_resumed(file):
    JsonLines(file, OPTIONS, resume=False)
    with pytest.raises(OtherRunError, match=r'rounds": 20.*rounds": 30'):
        JsonLines(file, {"rounds": 30}, resume=True)


def test_without_resume_it_starts_over(file):
    JsonLines(file, OPTIONS, resume=False).add({"step": "a"})
    assert JsonLines(file, OPTIONS, resume=False).found == []
    assert JsonLines(file, OPTIONS, resume=True).found == []


def test_resuming_a_missing_file_finds_nothing(file):
    assert JsonLines(file, OPTIONS, resume=True).found == []
