from threading import Thread
from types import SimpleNamespace
from typing import Any

from timelines.demo import __main__ as command


def a_plan(second):
    tasks = {"slam": {"share": second / 10}}
    return {"trigger": 100.0 + second, "contexts": [], "tasks": tasks, "cause": f"sample {second}"}


class Player(Thread):
    """Ends after so many looks."""

    def __init__(self, looks):
        self.looks = looks

    def is_alive(self):
        return self.looks > 0

    def join(self, timeout=None):
        del timeout
        self.looks -= 1


def test_a_plan_that_comes_while_another_is_printed_is_printed_too(monkeypatch):
    recording: Any = SimpleNamespace(plans=[a_plan(1)])
    printed: list[str] = []

    def console_print(line, **_):
        if not printed:
            recording.plans.append(a_plan(2))
        printed.append(line)

    monkeypatch.setattr(command, "console", SimpleNamespace(print=console_print))
    command._show_lines(recording, Player(looks=3), started=100.0)
    assert [line.split()[0] for line in printed] == ["1.00", "2.00"]
