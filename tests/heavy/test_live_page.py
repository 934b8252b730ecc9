"""The live page in a real browser, on a desk and on a phone; `PICTURES=1` keeps the screenshots of the README."""

from __future__ import annotations

import os
import time
from types import SimpleNamespace

import pytest

from contextpolicy.actuators.resize import pod_patch
from contextpolicy.live.page_server import PageServer
from contextpolicy.policies import plan_publisher, policy_runner, queries
from contextpolicy.streams import subscription
from contextpolicy.telemetry import resize_watch
from tests.cluster.builders import a_pod
from tests.heavy.browser import Browser
from tests.node.layout import REPOSITORY
from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.builders import a_policy, resources
from tests.virtual_operator import VirtualOperator

TASKS = ("slam", "speech", "signs")
STORY: tuple[tuple[dict[str, dict[str, float]], float], ...] = (
    ({"robot/imu": {"speed": 0.0}, "robot/mic": {"level": 0.0}, "robot/camera": {"signs": 0}}, 12.0),
    ({"robot/mic": {"level": 0.6}}, 15.0),
    ({"robot/camera": {"signs": 2}}, 12.0),
    ({"robot/imu": {"speed": 0.4}}, 20.0),
    ({"robot/mic": {"level": 0.0}}, 10.0),
    ({"robot/camera": {"signs": 0}}, 8.0),
    ({"robot/imu": {"speed": 0.0}}, 9.0),
    ({"robot/mic": {"level": 0.5}}, 6.0),
)
"""The paper's exp1 in short: what is heard, and for how long."""


def a_robot():
    """A policy in the manner of the paper's experiments."""
    return a_policy(
        streams=[a_stream(name, staleAfter="300s") for name in ("imu", "mic", "camera")],
        tasks=[
            a_task("slam", priority=10, activity=[{"stream": "imu", "when": "imu.speed > 0.1", "score": 1}], idle=0.1),
            a_task(
                "speech", priority=10, activity=[{"stream": "mic", "when": "mic.level > 0.1", "score": 1}], idle=0.1
            ),
            a_task(
                "signs", priority=5, activity=[{"stream": "camera", "when": "camera.signs > 0", "score": 1}], idle=0.1
            ),
        ],
        contexts=[
            a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}, "slam": {"scale": 2}}),
            a_context("dialogue", "mic.level > 0.1 && imu.speed <= 0.1", {"speech": {"scale": 2}}),
        ],
    )


@pytest.fixture(scope="module")
def page():
    """The address of a page about a robot that has had an eventful minute and a half."""
    operator = VirtualOperator(*(a_pod(name, {name: resources()}) for name in TASKS))
    clock = SimpleNamespace(monotonic=lambda: operator.loop.to_seconds(operator.loop.now), time=time.time)
    with pytest.MonkeyPatch.context() as patch:
        for module in (plan_publisher, policy_runner, queries, subscription, resize_watch, pod_patch):
            patch.setattr(module, "time", clock)
        operator.list_all("4")
        operator.connect()
        operator.apply(a_robot())
        for news, lasts in STORY:
            for key, value in news.items():
                operator.sample(key, **value)
            operator.settle()
            operator.turn(lasts)
        operator.loop.inline = True
        server = PageServer(0, operator.operator.queries)
        server.start()
        yield f"http://localhost:{server.server_port}/"
        server.close()


@pytest.fixture(scope="module")
def browser():
    opened = Browser()
    yield opened
    opened.close()


@pytest.fixture
def desk(browser, page):
    browser.open(page, 1200, 860)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    return browser


def slide(browser, value):
    browser.value(
        f"(() => {{ const s = document.getElementById('slider'); s.value = {value};"
        " s.dispatchEvent(new Event('input')); })()"
    )


def text(browser, identity):
    return browser.value(f"document.getElementById('{identity}').textContent")


def drawn(browser, figure, attribute):
    found = f"[...document.querySelectorAll('#{figure} [{attribute}]')]"
    return browser.value(f"[...new Set({found}.map(e => e.getAttribute('{attribute}')))]")


def test_it_shows_the_papers_figures_with_bands_of_contexts(desk):
    assert set(drawn(desk, "weights", "data-task")) == set(TASKS)
    assert set(drawn(desk, "shares", "data-task")) == set(TASKS)
    assert set(drawn(desk, "contexts", "data-context")) == {"moving", "dialogue"}
    assert text(desk, "headline").startswith("dialogue — ")
    assert text(desk, "state") == "live"


def test_it_says_why_a_task_has_its_share(desk):
    desk.value("document.querySelector('#tasks tbody tr').click()")
    desk.wait_for("document.querySelector('#why li')")
    assert "slam gets" in text(desk, "why")


def test_the_slider_goes_back_in_time_and_the_button_returns(desk):
    slide(desk, 700)
    assert text(desk, "state") == "back in time"
    assert text(desk, "headline").startswith("moving — ")
    assert "suspended" in text(desk, "tasks")
    assert desk.value("document.querySelectorAll('svg .cursor').length") == 3
    time.sleep(1.2)  # two more answers of the operator must not pull it back
    assert text(desk, "headline").startswith("moving — ")
    desk.value("document.getElementById('live').click()")
    assert text(desk, "state") == "live"


def test_it_fits_on_a_phone(browser, page):
    browser.open(page, 390, 844, phone=True)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    assert browser.value("document.documentElement.scrollWidth") <= 390
    smallest = "Math.min(...[...document.querySelectorAll('select, button, input')].map(e => e.offsetHeight))"
    assert browser.value(smallest) >= 32, "a finger must hit it"
    if os.environ.get("PICTURES"):
        browser.picture(REPOSITORY / "operator" / "live-page-phone.png")


def test_nothing_comes_from_elsewhere_and_nothing_fails(desk, page):
    assert desk.hosts <= {page.rstrip("/"), f"{page}api", "data:"}
    assert desk.errors == []
    if os.environ.get("PICTURES"):
        slide(desk, 650)
        desk.value("document.querySelector('#tasks tbody tr').click()")
        desk.picture(REPOSITORY / "operator" / "live-page.png")
