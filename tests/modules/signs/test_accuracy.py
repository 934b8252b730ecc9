"""How well both networks read signs in fonts that they never saw, and that the command says so."""

from __future__ import annotations

import re

import pytest

from modules.signs import accuracy, drives
from modules.signs.accuracy import NOTHING, aligned, draw, middle
from modules.signs.drives import Passages
from modules.signs.reading import Character, Reading
from modules.signs.watcher import Watcher

GOALS = {("paddle", 1): 0.8, ("paddle", 2): 0.9, ("digits", 1): 0.6, ("digits", 2): 0.8}
"""What is read right, at least, over all sets: docs/measurements/modules.md has what was measured."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("rendered")


def test_both_networks_read_both_formats(folder, capsys):
    assert accuracy.main(["--rendered", str(folder), "--count", "4"]) == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if re.match(r"\| [a-z ]+ \| [12]", line)]
    assert len(rows) == 6 * 2 * 2
    for (reader, form), goal in GOALS.items():
        mine = [row for row in rows if (row[2], int(row[1])) == (reader, form)]
        count = sum(int(row[3]) for row in mine)
        right = sum(int(row[3]) * float(row[6].strip("% |")) / 100 for row in mine)
        assert right / count >= goal, (reader, form)


def test_a_bad_file_is_one_line(tmp_path, capsys):
    (tmp_path / "x_32x32.mat").write_bytes(b"garbage")
    assert accuracy.main([str(tmp_path / "x_32x32.mat")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_same_signs_are_drawn_each_time(tmp_path):
    first, second = (draw(tmp_path / name, 1) for name in ("a", "b"))
    for one, other in zip(first, second, strict=True):
        if one.suffix == ".mat" and one.name == "digitStruct.mat":
            assert (one.parent / "1.png").read_bytes() == (other.parent / "1.png").read_bytes()


def test_digits_are_aligned_with_the_reading():
    assert aligned("214", "274") == [("2", "2"), ("1", "7"), ("4", "4")]
    assert aligned("214", "24") == [("2", "2"), ("1", NOTHING), ("4", "4")]
    assert aligned("24", "214") == [("2", "2"), (NOTHING, "1"), ("4", "4")]
    assert aligned("7", "") == [("7", NOTHING)]


def test_the_digit_in_the_middle_counts():
    seen = Reading(tuple(Character(label, 1, position) for label, position in (("1", 0.1), ("7", 0.6), ("A", 0.5))))
    assert middle(seen) == "7"
    assert middle(Reading()) == NOTHING


class Scripted(Watcher):
    """Returns prepared texts, picture by picture."""

    def __init__(self, texts):
        self.texts = texts
        self.at = 0

    def watch(self, picture, stamp):
        del picture, stamp
        self.at += 1
        return [type("Sign", (), {"text": text}) for text in self.texts.get(self.at, ())]


def test_a_drive_counts_correct_repeated_wrong_and_missed_signs(monkeypatch):
    monkeypatch.setattr(drives, "_picture", lambda *_: None)
    monkeypatch.setattr(drives, "any_number", Numbers())
    reported = drives.drive(Scripted({3: ["11"], 9: ["22"], 12: ["22"], 20: ["99"], 70: ["33", "22"]}), 1)
    assert (reported.passages, reported.once, reported.again, reported.wrong) == (6, 4, 1, 1)
    assert (reported + reported).passages == 12
    assert "missed 2" in reported.report()
    assert Passages().report()


class Numbers:
    """Gives 11, 22 and 33."""

    def __init__(self):
        self.count = 0

    def __call__(self, rng):
        del rng
        self.count += 1
        return f"{self.count}{self.count}"
