from __future__ import annotations

import json

import pytest

from robotkit import ask
from tests.modules.robotkit.bus import router
from tests.modules.robotkit.world import ECHO, Echo, running
from tests.waiting import PATIENCE


@pytest.mark.parametrize(("what", "field"), [("profile", "inputs"), ("health", "misses")])
def test_a_running_task_answers(what, field, capsys, monkeypatch):
    monkeypatch.setattr(ask, "PATIENCE_S", PATIENCE)
    with running(ECHO, Echo()) as world:
        world.ask("robot/echo/profile")
        assert ask.main(["echo", what, "--connect", world.address]) == 0
    assert field in json.loads(capsys.readouterr().out)


def test_a_task_that_does_not_run_is_reported(capsys, monkeypatch):
    monkeypatch.setattr(ask, "PATIENCE_S", 0.1)
    with router() as address:
        assert ask.main(["nobody", "profile", "--connect", address]) == 1
    assert "robot/nobody/profile: no answer within 0.1 s" in capsys.readouterr().err


def test_an_address_is_needed(capsys):
    assert ask.main(["slam", "health", "--connect", ""]) == 2
    assert "ZENOH_CONNECT" in capsys.readouterr().err
