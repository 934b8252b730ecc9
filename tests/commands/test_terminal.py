"""What a terminal changes, and that nothing else does."""

from __future__ import annotations

import io
from typing import ClassVar

import pytest

from contextpolicy.commands import terminal


class Screen(io.StringIO):
    """A terminal, or a file."""

    def __init__(self, *, real: bool) -> None:
        super().__init__()
        self._real = real

    def isatty(self) -> bool:
        return self._real


class Clock:
    """A timer that goes off when the test says so."""

    last: ClassVar[Clock]

    def __init__(self, seconds, function):
        self.seconds, self.go_off, self.daemon = seconds, function, False
        Clock.last = self

    def start(self):
        self.state = "running"

    def cancel(self):
        self.state = "cancelled"

    def join(self):
        assert self.state == "cancelled"


@pytest.fixture
def screen(monkeypatch):
    def set_up(*, real):
        shown = Screen(real=real)
        monkeypatch.setattr("sys.stderr", shown)
        monkeypatch.setattr("sys.stdout", shown)
        monkeypatch.setattr(terminal, "Timer", Clock)
        monkeypatch.delenv("COLUMNS", raising=False)
        monkeypatch.setenv("TERM", "xterm")
        return shown

    return set_up


def test_file_output_has_no_width_unless_columns_is_set(screen, monkeypatch):
    screen(real=False)
    assert terminal.columns() is None
    monkeypatch.setenv("COLUMNS", "40")
    assert terminal.columns() == 40


@pytest.mark.parametrize("columns", ["", "wide", "0"])
def test_terminal_width_ignores_invalid_columns(screen, monkeypatch, columns):
    screen(real=True)
    monkeypatch.setenv("COLUMNS", columns)
    width = terminal.columns()
    assert width is not None
    assert width > 0


def test_slow_work_is_reported(screen):
    shown = screen(real=True)
    with terminal.waiting("asking the API server"):
        assert (Clock.last.state, Clock.last.seconds) == ("running", 2.0)
        assert shown.getvalue() == ""
        Clock.last.go_off()
    _, reported, ended = shown.getvalue().rpartition("asking the API server ...")
    assert reported
    assert (SHOW_CURSOR in ended, ERASE_LINE in ended) == (True, True), "and taken back"


SHOW_CURSOR, ERASE_LINE = "\x1b[?25h", "\x1b[2K"


def test_quick_work_is_not_reported(screen):
    shown = screen(real=True)
    with pytest.raises(KeyError), terminal.waiting("asking the API server"):
        raise KeyError
    assert Clock.last.state == "cancelled"
    assert "asking" not in shown.getvalue()


def test_files_get_no_progress(screen):
    shown = screen(real=False)
    with terminal.waiting("asking"), terminal.progress(10, "simulating") as report:
        assert report is None
    assert shown.getvalue() == ""


def test_a_bar_on_a_terminal(screen):
    shown = screen(real=True)
    with terminal.progress(10, "simulating") as report:
        assert report is not None
        report(10)
    assert "simulating" in shown.getvalue()
    assert "100%" in shown.getvalue()
