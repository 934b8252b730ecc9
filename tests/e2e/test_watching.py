"""What people watch: the real /metrics against the dashboard, and the live page, through kubectl's port-forward."""

from __future__ import annotations

import json
import re
import urllib.request

import pytest
import yaml

from contextpolicy.cli import main
from contextpolicy.commands.cluster_access import api_server
from contextpolicy.commands.operator_access import operator as live_page
from tests.charts.test_monitoring import QUESTIONS
from tests.e2e.cluster import until
from tests.e2e.metrics_page import address, scrape, series

POLICY = "e2e-robot/robot"
SHARES = {"slam": 990, "speech": 10}
ELSEWHERE = "contextpolicy_agent_", "contextpolicy_router_"
WITHOUT_TROUBLE = {"contextpolicy_samples_dropped_total"}
"""Series that appear with the first sample that is not used."""
ON_A_CLOSED_BUS = {"contextpolicy_certificate_expiry_timestamp_seconds"}
"""Series of programs that have certificates: this release has `security.enabled: false`. `test_bus_security.py` asks a
release that has them."""


@pytest.mark.usefixtures("moving")
def test_dashboard_and_alert_series_are_exported():
    asked = {name for _, expression, _ in QUESTIONS for name in re.findall(r"\bcontextpolicy_[a-z_]+", expression)}
    here = {name for name in asked if not name.startswith(ELSEWHERE)} - {"contextpolicy_node_agent_ready"}
    assert here - WITHOUT_TROUBLE - ON_A_CLOSED_BUS <= series(scrape("operator"))
    assert {name for name in asked if name.startswith("contextpolicy_router_")} <= series(scrape("router"))


def reactions():
    found = re.search(r"^contextpolicy_reaction_seconds_count\{[^}]*\} (\S+)$", scrape("operator"), flags=re.MULTILINE)
    return float(found.group(1)) if found else None


def test_a_reaction_is_measured(moving):
    """Not that of a policy's first plan, which may be made when the robot moves already: it changes no known share."""
    before = reactions()
    moving.drive(0.0)
    moving.expect(slam=500, speech=500)
    until("it is counted", lambda: (now := reactions()) > before or now)


@pytest.mark.usefixtures("moving")
def test_metrics_match_the_enforced_limits():
    until(
        "the limit is on the page",
        lambda: bool(
            re.search(
                r'^contextpolicy_container_limit_cores\{[^}]*task="slam"\} 0\.99$',
                scrape("operator"),
                flags=re.MULTILINE,
            )
        ),
    )
    text = scrape("operator")
    assert 'contextpolicy_context_active{context="moving",name="robot",namespace="e2e-robot"} 1.0' in text
    assert "contextpolicy_bus_connected 1.0" in text
    assert re.search(r"^contextpolicy_router_clients [2-9]", scrape("router"), flags=re.MULTILINE)


@pytest.mark.usefixtures("moving")
def test_the_live_page_through_a_port_forward():
    with api_server() as api, live_page(api) as ask:
        boards = {board["policy"]: board for board in ask("boards")}
        plans = ask("plans", policy=POLICY)
    board = boards[POLICY]
    assert board["contexts"]["moving"]["active"]
    assert board["why"]["slam"][0].startswith("slam gets 990m")
    assert board["streams"]["imu"]["age"] < 60
    assert plans[-1]["contexts"] == ["moving"]


def test_live_page_is_not_reachable_over_the_network(moving):
    del moving
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(f"http://{address('operator')}:8082/", timeout=10)


@pytest.mark.usefixtures("moving")
def test_the_commands_of_kubectl_ctxp(capsys, monkeypatch):
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    assert main(["explain", POLICY, "slam"]) == 0
    assert capsys.readouterr().out.startswith("slam gets 990m on node ")
    assert main(["why-not", POLICY, "moving"]) == 1
    assert main(["top", "--once", "--output", "json"]) == 0
    assert POLICY in capsys.readouterr().out
    until("the status is written", lambda: main(["status", POLICY, "-o", "yaml"]) in (0, 1))
    capsys.readouterr()
    main(["status", POLICY, "-o", "yaml"])
    assert yaml.safe_load(capsys.readouterr().out)["policy"] == POLICY
    main(["doctor", "-o", "json"])
    checks = {check["subject"]: check for check in json.loads(capsys.readouterr().out)["items"]}
    assert checks["API server"]["verdict"] == "ok"
    assert checks["operator's rights"]["verdict"] == "ok", checks["operator's rights"]
    assert checks["bus"]["verdict"] == "ok"
    [cgroups] = [check for subject, check in checks.items() if subject.startswith("cgroups of ")]
    assert cgroups["verdict"] == "ok"


def test_recording_is_replayed_offline(moving, tmp_path, capsys):
    moving.drive(0.0)
    moving.expect(slam=500, speech=500)
    folder = tmp_path / "recorded"
    assert main(["record", POLICY, "--to", str(folder), "--last", "120"]) == 0
    command = capsys.readouterr().out.splitlines()[-1].split()
    assert main([*command[1:], "--output", "csv"]) == 0
    assert "moving" in capsys.readouterr().out


def test_forced_and_paused_by_command(moving):
    moving.drive(0.0)
    moving.expect(slam=500, speech=500)
    assert main(["force", POLICY, "moving", "--for", "5m"]) == 0
    moving.expect(**SHARES)
    assert main(["force", POLICY, "--end"]) == 0
    moving.expect(slam=500, speech=500)
    assert main(["dry-run", POLICY]) == 0
    assert main(["resume", POLICY]) == 0
    moving.expect(slam=500, speech=500)
