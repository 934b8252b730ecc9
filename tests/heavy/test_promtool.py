"""promtool, built from source, on the alert rules and on what the programs export."""

from __future__ import annotations

import subprocess

import pytest
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.metrics import MetricWrapperBase

from contextpolicy.agent import agent_metrics
from contextpolicy.telemetry import build_info, certificate_metrics, liveness, metrics, router_metrics
from contextpolicy.telemetry.scrape import Scrape
from tests.charts.conftest import CHART
from tests.node import build
from tests.node.layout import REPOSITORY


@pytest.fixture(scope="session")
def promtool():
    program = build.build(build.PROMTOOL) / "promtool"

    def run(*arguments, text=""):
        return subprocess.run(
            [program, *arguments], input=text, capture_output=True, text=True, timeout=120, check=False
        )

    return run


def test_the_rules_are_valid(promtool):
    for name, rules in (("alerts", 20), ("expected", 1)):
        done = promtool("check", "rules", str(CHART / "files" / f"{name}.yaml"))
        assert done.returncode == 0, done.stderr
        assert f"{rules} rules found" in done.stdout


def test_rules_pass_promtool_tests(promtool):
    done = promtool("test", "rules", str(REPOSITORY / "tests" / "charts" / "alerts_test.yaml"))
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_metrics_keep_prometheus_conventions(promtool):
    registry = CollectorRegistry()
    for module in (metrics, agent_metrics, build_info, certificate_metrics, liveness, router_metrics):
        for one in vars(module).values():
            if isinstance(one, MetricWrapperBase):
                registry.register(one)
    registry.register(Scrape(lambda: None))
    registry.register(liveness.LoopDelays(lambda: {"the event loop": 0.0}))
    metrics.REACTION.labels("lab", "robot").observe(0.01)
    done = promtool("check", "metrics", text=generate_latest(registry).decode())
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
