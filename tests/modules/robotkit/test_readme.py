"""The README's module, as it stands there, as a program on a bus; and the fake plan of the reference page."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

import robotkit
from tests.modules.robotkit.bus import Matching, client, router

README = Path(robotkit.__file__).parents[1] / "README.md"
REFERENCE = README.parents[2] / "docs" / "reference" / "robotkit.md"
EXIT_S = 30


def blocks(language, page=README):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.fixture
def folder(tmp_path):
    loudness = tmp_path / "loudness"
    loudness.mkdir()
    (loudness / "module.yaml").write_text(blocks("yaml")[0], encoding="utf-8")
    (loudness / "__main__.py").write_text(blocks("python")[0], encoding="utf-8")
    return loudness


@contextmanager
def started(folder, **environment):
    environment = {**os.environ, "PYTHONPATH": str(README.parent), **environment}
    process = subprocess.Popen(
        [sys.executable, str(folder)], env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def test_the_module_is_as_short_as_promised():
    lines = [line for line in blocks("python")[0].splitlines() if line]
    assert len(lines) <= 14


def test_the_module_runs_receives_a_plan_and_ends_on_a_signal(folder):
    with router() as address, client(address) as session:
        microphone = session.declare_publisher("robot/microphone")
        listening = Matching(microphone)
        plans = session.declare_publisher("contextpolicy/test/fake/plan")
        hearing = Matching(plans)
        levels = session.declare_subscriber("robot/loudness/level")
        with started(folder, ZENOH_CONNECT=address) as process:
            listening.wait(expected=True)
            microphone.put(b"odd")
            microphone.put((16384).to_bytes(2, "little") * 10)
            assert json.loads(levels.recv().payload.to_bytes())["level"] == 0.5
            hearing.wait(expected=True)  # it works before it hears plans
            exec(blocks("python", REFERENCE)[0].replace("tcp/127.0.0.1:7447", address), {})  # noqa: S102 - our own page
            listening.wait(expected=False)
            process.send_signal(signal.SIGTERM)
            assert process.wait(EXIT_S) == 0


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"ZENOH_CONNECT": ""}, "ZENOH_CONNECT is empty: set it to the router's address, such as tcp/127.0.0.1:7447\n"),
        ({"ZENOH_CONNECT": "nonsense"}, "nonsense"),
        (
            {"ZENOH_CONNECT": "tcp/127.0.0.1:1", "SHARED_MEMORY": "yes"},
            "SHARED_MEMORY: invalid value 'yes': expected true or false",
        ),
        ({"ZENOH_CONNECT": "tcp/127.0.0.1:1", "INPUT_AUDIO": "/x"}, "inputs.audio.key: invalid value '/x'"),
    ],
)
def test_a_wrong_configuration_is_one_line_and_exit_code_2(folder, environment, message):
    with started(folder, **environment) as process:
        _, errors = process.communicate(timeout=EXIT_S)
    assert process.returncode == 2
    assert message in errors
    assert len(errors.splitlines()) == 1


def test_a_module_that_waits_for_its_router_ends_on_a_signal(folder):
    with started(folder, ZENOH_CONNECT="tcp/127.0.0.1:1") as process:
        waiting = process.stderr.readline()
        assert "no Zenoh router answers yet" in waiting
        assert ".rs" not in waiting  # where Zenoh's source raised it
        process.send_signal(signal.SIGTERM)
        assert process.wait(EXIT_S) == 0


def test_a_module_that_is_busy_in_a_library_ends_on_a_signal(folder):
    """As process 1 of a container it would live on until it is killed."""
    program = folder / "__main__.py"
    slow = "import sys, time\ndef build():\n    sys.stderr.write('busy\\n'); sys.stderr.flush(); time.sleep(600)\n"
    text = (
        program.read_text(encoding="utf-8").replace("main(Path", slow + "main(Path").replace(", Loudness)", ", build)")
    )
    program.write_text(text, encoding="utf-8")
    with started(folder, ZENOH_CONNECT="tcp/127.0.0.1:1") as process:
        assert process.stderr.readline() == "busy\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(EXIT_S) == 0
