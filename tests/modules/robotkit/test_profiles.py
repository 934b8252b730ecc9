from __future__ import annotations

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from robotkit import profiles
from robotkit.runner import Runner
from tests.modules.robotkit.bus import client, router
from tests.modules.robotkit.world import ECHO, Echo, running


def test_a_query_to_all_collects_every_profile(capsys):
    with running(ECHO, Echo()) as world, client(world.address) as second, ThreadPoolExecutor(1) as pool:
        stop = threading.Event()
        done = pool.submit(Runner(second, replace(ECHO, name="twin"), Echo(), shared_memory=False).run, stop)
        world.ask("robot/echo/profile")
        world.ask("robot/twin/profile")
        assert profiles.main(["--connect", world.address]) == 0
        stop.set()
        done.result()
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert list(document["tasks"]) == ["echo", "twin"]
    assert document["tasks"]["twin"]["inputs"]["words"]["key"] == ECHO.inputs["words"].key
    assert "note: echo has not processed any input yet" in printed.err


def test_missing_answers_are_reported(capsys, monkeypatch):
    monkeypatch.setattr(profiles, "PATIENCE_S", 0.1)
    with router() as address:
        assert profiles.main(["--connect", address]) == 1
    assert "robot/*/profile: no answer within 0.1 s" in capsys.readouterr().err
    assert profiles.main(["--connect", ""]) == 2
