"""`contextpolicy top` on a bus with a router and no operator."""

from __future__ import annotations

import json
import threading
from typing import TYPE_CHECKING, Any

import pytest

from contextpolicy import cli
from contextpolicy.bus.session import open_router
from contextpolicy.bus.view import BusView
from contextpolicy.cli import main
from contextpolicy.commands import top
from tests.bus.messages import BOARD, KEY, plan, step
from tests.waiting import PATIENCE

if TYPE_CHECKING:
    from collections.abc import Iterator

    import zenoh

PLANS = "contextpolicy/*/*/plan"


class Operator:
    """Somebody who makes plans."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint, self.current = endpoint, plan()
        self._session = open_router([endpoint])
        self._answer: Any = self._session.declare_queryable(KEY, self._on_query)

    def put(self, topic: str, message: dict[str, Any]) -> None:
        self._session.put(f"contextpolicy/robot/delivery/{topic}", json.dumps(message))

    def close(self) -> None:
        self._session.close()

    def _on_query(self, query: zenoh.Query) -> None:
        with query:
            query.reply(KEY, json.dumps(self.current))


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a machine that is busy."""
    monkeypatch.setattr("contextpolicy.commands.explain.PATIENCE", PATIENCE)
    monkeypatch.setattr("contextpolicy.commands.top.PATIENCE", PATIENCE)


@pytest.fixture
def operator(free_endpoint: str) -> Iterator[Operator]:
    opened = Operator(free_endpoint)
    yield opened
    opened.close()


def test_once_as_json(operator: Operator, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["top", "--connect", operator.endpoint, "--once", "--output", "json"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    shown = json.loads(line)
    assert (shown["policy"], shown["contexts"]) == ("robot/delivery", ["moving"])
    assert shown["tasks"]["speech"] == {"weight": 0.0, "share": 0.01, "suspended": True, "stage": "planned"}


def test_once_as_a_table(operator: Operator, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["top", "--connect", operator.endpoint, "--once"]) == 0
    out = capsys.readouterr().out
    assert "robot/delivery   context: moving" in out
    assert "990m" in out


def test_every_message_becomes_a_line(operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[dict[str, Any]] = []
    heard = threading.Event()

    def collect(text: str, **_: object) -> None:
        lines.append(json.loads(text))
        if len(lines) == 1:
            operator.put("applied", step("accepted", 0.99))
        if len(lines) == 2:  # each subscriber has a thread of its own: one sent now may be shown before the step
            operator.put("plan", plan(sequence=2, contexts=[]))
        if len(lines) == 3:
            heard.set()
            raise KeyboardInterrupt

    monkeypatch.setattr("builtins.print", collect)
    assert main(["top", "--connect", operator.endpoint, "--output", "json"]) == 0
    assert heard.is_set()
    assert [line["contexts"] for line in lines] == [["moving"], ["moving"], []]
    assert lines[1]["tasks"]["slam"]["stage"] == "accepted"


def test_missing_operator_is_reported(free_endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with open_router([free_endpoint]):
        assert main(["top", "--connect", free_endpoint, "--once"]) == 2
    assert "check that the operator is running and has a policy" in capsys.readouterr().err


def test_the_environment_names_the_router(
    operator: Operator, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ZENOH_CONNECT", operator.endpoint)
    assert main(["top", "--once", "--output", "json"]) == 0
    assert "robot/delivery" in capsys.readouterr().out


@pytest.mark.parametrize("last", [plan(), None], ids=["a plan", "no plan"])
def test_top_drops_a_removed_policy(last: dict[str, Any] | None) -> None:
    view = BusView()
    top._take_all(view, [{**BOARD, "plan": last}])
    assert view.boards
    top._take_all(view, [])
    assert (view.policies, view.boards) == ({}, {})


def test_without_a_terminal_each_change_is_written_once(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = cli.build_parser("contextpolicy").parse_args(["top"])
    story = iter([[BOARD], [BOARD], [{**BOARD, "plan": plan(sequence=9, contexts=["docked"])}]])
    view = BusView()

    def take() -> None:
        boards = next(story, None)
        if boards is None:
            raise KeyboardInterrupt
        top._take_all(view, boards)

    with pytest.raises(KeyboardInterrupt):
        top._show(arguments, view, take, lambda: None)
    reported = [line for line in capsys.readouterr().out.splitlines() if line.startswith("robot/delivery")]
    assert [line.split("context: ")[1].split()[0] for line in reported] == ["moving", "docked"]
