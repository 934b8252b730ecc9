"""The documents' pictures of the live page, light and dark: a robot with agents on the node, through a port-forward.

`PICTURES=1` keeps them. A virtual clock would show reactions of 0 ms, and nothing that a kubelet or an agent measures.
"""

from __future__ import annotations

import os
import re
import subprocess
import time
from contextlib import contextmanager

import pytest

from tests.e2e.agents import NAMESPACE, SYSTEM, Component, installed
from tests.e2e.cluster import run
from tests.e2e.robot import Robot, Sensors, task
from tests.heavy.browser import Browser
from tests.node.layout import REPOSITORY
from tests.planning.builders import a_context

PRIORITIES = {"slam": 10, "speech": 10, "signs": 5, "navigation": 8}
WORK = """
import time
while True:
    end = time.process_time() + 0.03
    while time.process_time() < end:
        pass
    time.sleep(0.05)
"""
ACTIVE = {
    "slam": ("imu", "imu.speed > 0.1"),
    "speech": ("mic", "mic.level > 0.1"),
    "signs": ("camera", "camera.signs > 0"),
    "navigation": ("imu", "imu.speed > 0.1"),
}
STORY = (
    ({"imu": {"speed": 0.0}, "mic": {"level": 0.0}, "camera": {"signs": 0}}, 8.0),
    ({"mic": {"level": 0.6}}, 12.0),
    ({"camera": {"signs": 2}}, 10.0),
    ({"imu": {"speed": 0.4}}, 15.0),
    ({"mic": {"level": 0.0}}, 8.0),
    ({"camera": {"signs": 0}}, 8.0),
    ({"imu": {"speed": 0.0}}, 8.0),
    ({"mic": {"level": 0.5}}, 5.0),
)
"""The paper's exp1 in short: what is heard, and for how many seconds."""


@pytest.fixture(scope="module")
def page():
    """The page of a robot that has had an eventful minute."""
    with installed() as connect, connect("module") as session, Sensors(session) as sensors:
        Component("agent").wait()
        robot = Robot(NAMESPACE, sensors)
        robot.start(*PRIORITIES, command=["python3", "-c", WORK])
        robot.policy(
            reserve="500m",
            streams=[{"name": name, "key": f"{NAMESPACE}/{name}", "staleAfter": "2s"} for name in STORY[0][0]],
            tasks=[task(name, priority=PRIORITIES[name], idle=0.1, activity=[active(name)]) for name in PRIORITIES],
            contexts=[
                a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}, "slam": {"scale": 2}}),
                a_context("dialogue", "mic.level > 0.1 && imu.speed <= 0.1", {"speech": {"scale": 2}}),
            ],
            enforcement={"control": "Weight"},
        )
        for news, lasts in STORY:
            for name, value in news.items():
                sensors.read(f"{NAMESPACE}/{name}", value)
            time.sleep(lasts)
        with forwarded() as port:
            yield f"http://localhost:{port}/"
        robot.stop(*PRIORITIES)


def active(name):
    stream, when = ACTIVE[name]
    return {"stream": stream, "when": when, "score": 1}


@contextmanager
def forwarded():
    """The local port that leads to the operator's page."""
    pod = run("kubectl", "get", "pods", "-n", SYSTEM, "-l", "app.kubernetes.io/component=operator", "-o", "name")
    forward = subprocess.Popen(
        ["kubectl", "port-forward", "-n", SYSTEM, pod.split()[0], ":8082"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert forward.stdout is not None
        line = forward.stdout.readline()
        found = re.search(r"127\.0\.0\.1:(\d+)", line)
        assert found is not None, line
        yield int(found[1])
    finally:
        forward.terminate()
        forward.communicate()


@pytest.fixture(scope="module")
def browser():
    opened = Browser()
    yield opened
    opened.close()


def test_a_real_robot(browser, page):
    browser.open(page, 1200, 860)
    browser.wait_for(f"document.querySelectorAll('#tasks tbody tr').length == {len(PRIORITIES)}")
    browser.wait_for("/median [1-9]/.test(document.getElementById('reactions').textContent)")
    browser.wait_for(
        "[...document.querySelectorAll('#tasks tbody tr')].every(row => /\\dm/.test(row.cells[4].innerText))"
    )
    browser.value("document.querySelector('#tasks tbody button').click()")
    for figure in ("weights", "shares"):
        assert browser.value(f"document.querySelectorAll('#{figure} [data-task]').length") == len(PRIORITIES), figure
    assert browser.value("document.getElementById('state').textContent") == "live"
    assert browser.value("document.getElementById('problem').textContent") == ""
    assert browser.errors == []
    if os.environ.get("PICTURES"):
        for scheme, name in (("light", "live-page.png"), ("dark", "live-page-dark.png")):
            browser.picture(REPOSITORY / "operator" / name, scheme)
