"""Commands that steer and show policies of a cluster, on a small API server and an operator's live page."""

from __future__ import annotations

import json
import shutil
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import pytest
import yaml

from contextpolicy import cli
from contextpolicy.commands import cluster_access
from contextpolicy.live.page_server import PageServer
from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.streams import timeline
from tests.cluster.builders import a_pod
from tests.policies.builders import IMU, a_policy, resources
from tests.virtual_operator import VirtualOperator

POLICIES = "/apis/contextpolicy.dev/v1alpha1/namespaces/lab/contextpolicies"


class Cluster(ThreadingHTTPServer):
    """Serves one policy, and `others` by name, and keeps what is merged into them; None for one that is deleted."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Api)
        self.policy = {**a_policy(), "status": {}}
        self.others: dict[str, Any] = {}
        self.patches: list[tuple[str, Any]] = []


class Api(BaseHTTPRequestHandler):
    server: Cluster

    def do_GET(self):
        path, policy = self.path.partition("?")[0], self.server.policy
        known = {
            f"{POLICIES}/robot": policy,
            POLICIES: {"items": [policy]},
            "/apis/contextpolicy.dev/v1alpha1/contextpolicies": {"items": [policy]},
            **{f"{POLICIES}/{name}": other for name, other in self.server.others.items()},
        }
        self._answer(known.get(path))

    def do_PATCH(self):
        patch = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.patches.append((self.path.partition("?")[0], patch))
        self._answer({})

    def do_DELETE(self):
        self.server.patches.append((self.path.partition("?")[0], None))
        self._answer({})

    def _answer(self, found):
        body = json.dumps({"message": "not found"} if found is None else found).encode()
        self.send_response(404 if found is None else 200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


@pytest.fixture
def cluster(monkeypatch, tmp_path):
    with Cluster() as server:
        Thread(target=server.serve_forever, daemon=True).start()
        config = {
            "current-context": "test",
            "clusters": [{"name": "test", "cluster": {"server": f"http://127.0.0.1:{server.server_port}"}}],
            "contexts": [{"name": "test", "context": {"cluster": "test", "user": "test", "namespace": "lab"}}],
            "users": [{"name": "test", "user": {}}],
        }
        path = tmp_path / "config"
        path.write_text(json.dumps(config))
        monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", str(path))
        yield server
        server.shutdown()


@pytest.fixture
def operator(monkeypatch, cluster):  # noqa: ARG001 - the commands find the operator through it
    """An operator whose robot has begun to move; what `kubectl port-forward` opens leads to it."""
    started = VirtualOperator(*(a_pod(name, {name: resources()}) for name in ("slam", "speech")))
    started.keep_time(monkeypatch)
    started.list_all()
    started.connect()
    started.apply(a_policy())
    for speed in (0.0, 0.3):
        started.sample(IMU, speed=speed)
        started.settle()
    started.turn(2.0)
    started.loop.inline = True
    server = PageServer(0, started.operator.queries)
    server.start()
    monkeypatch.setattr(cluster_access, "_pods", lambda _: [("lab", "operator", 8082)])
    monkeypatch.setattr(cluster_access, "_local_port", lambda _: server.server_port)
    monkeypatch.setattr(shutil, "which", lambda _: sys.executable)
    yield started
    server.close()


@pytest.mark.parametrize(("command", "mode"), [("pause", "Paused"), ("dry-run", "DryRun")], ids=lambda value: value)
def test_the_mode(cluster, capsys, command, mode):
    assert cli.main([command, "robot"]) == 0
    assert cluster.patches == [(f"{POLICIES}/robot", {"spec": {"mode": mode}})]
    assert capsys.readouterr().out == f"lab/robot: Enforce -> {mode}\n"


def test_what_is_so_already_is_left_alone(cluster, capsys):
    assert cli.main(["resume", "lab/robot"]) == 0
    assert cluster.patches == []
    assert capsys.readouterr().out == "robot: is Enforce\n"


def test_a_policy_that_is_not_there(cluster, capsys):
    assert cli.main(["pause", "robt"]) == 2
    assert "policy lab/robt is not allowed: one of robot" in capsys.readouterr().err
    assert cluster.patches == []


def test_a_context_is_forced_for_a_while(cluster):
    assert cli.main(["force", "robot", "moving", "--for", "5m"]) == 0
    [(_, patch)] = cluster.patches
    assert patch["spec"]["force"]["context"] == "moving"
    assert patch["spec"]["force"]["until"].endswith("Z")
    assert cli.main(["force", "robot", "--end"]) == 0
    assert cluster.patches[1][1] == {"spec": {"force": None}}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["robot", "movng"], "context movng is not allowed: one of moving"),
        (["robot"], "name a CONTEXT, or give --end"),
        (["robot", "moving", "--end"], "name a CONTEXT, or give --end"),
    ],
)
def test_what_cannot_be_forced(cluster, capsys, arguments, told):
    assert cli.main(["force", *arguments]) == 2
    assert told in capsys.readouterr().err
    assert cluster.patches == []


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("duration", ["0s", "2d", "soon", "-1m", "25h"])
def test_how_long_a_context_can_be_forced(capsys, duration):
    with pytest.raises(SystemExit):
        cli.main(["force", "robot", "moving", f"--for={duration}"])
    assert "a duration such as 30s, 5m or 2h, at most 24h" in capsys.readouterr().err


def test_the_status_for_people_and_programs(cluster, operator, capsys):
    cluster.policy["status"] = operator.cluster.statuses["lab/robot"]
    assert cli.main(["status"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("lab/robot: Ready, context: moving\n  plan 2 since ")
    assert "  slam    8       800m   1\n" in out
    assert cli.main(["status", "robot", "-o", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["contexts"] == ["moving"]
    assert cli.main(["status", "-A", "-o", "yaml"]) == 0
    assert yaml.safe_load(capsys.readouterr().out)[0]["ready"] is True


def test_a_status_that_is_not_well_is_exit_code_1_and_says_why(cluster, capsys):
    condition = {"type": "Applied", "status": "False", "reason": "NotApplied", "message": "raise the ResourceQuota"}
    cluster.policy["status"] = {"conditions": [condition]}
    assert cli.main(["status", "robot"]) == 1
    out = capsys.readouterr().out
    assert "lab/robot: NOT Ready, context: -" in out
    assert "Applied is False (NotApplied): raise the ResourceQuota" in out


@pytest.mark.usefixtures("operator")
def test_explain_and_why_not_through_the_cluster(capsys):
    assert cli.main(["explain", "robot", "slam"]) == 0
    assert capsys.readouterr().out.startswith("slam gets 800m")
    assert cli.main(["why-not", "robot"]) == 0
    assert capsys.readouterr().out == "all contexts hold\n"
    assert cli.main(["why-not", "robot", "moving"]) == 1
    assert "Context moving holds" in capsys.readouterr().out
    assert cli.main(["explain", "robot", "-o", "yaml"]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["policy"] == "lab/robot"


@pytest.mark.usefixtures("operator")
def test_top_through_the_cluster(monkeypatch, capsys):
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    monkeypatch.setattr("contextpolicy.commands.top.TICK", 0.0)
    assert cli.main(["top", "--once"]) == 0
    out = capsys.readouterr().out
    assert "lab/robot   context: moving" in out
    for heading in ("limit", "use", "throttled", "stream", "age", "sample to limit in force: median"):
        assert heading in out


@pytest.mark.usefixtures("operator")
def test_what_is_recorded_can_be_replayed(tmp_path, capsys):
    folder = tmp_path / "recorded"
    assert cli.main(["record", "robot", "--to", str(folder)]) == 0
    told = capsys.readouterr().out
    assert "2 samples" in told
    assert load_policy(str(folder / "policy.yaml")).reference == "lab/robot"
    assert len(list(timeline.load(folder / "timeline.json").inputs())) == 2
    assert [json.loads(line)["sequence"] for line in (folder / "plans.jsonl").read_text().splitlines()][-1] == 2
    command = told.splitlines()[-1].split()
    assert command[:2] == ["contextpolicy", "simulate"]
    assert "--node robot-1=1000m" in told
    assert cli.main(command[1:]) == 0
    assert "800m (8)" in capsys.readouterr().out


@pytest.mark.usefixtures("operator")
def test_a_folder_is_not_overwritten(tmp_path, capsys):
    assert cli.main(["record", "robot", "--to", str(tmp_path)]) == 2
    assert "a folder that does not exist yet" in capsys.readouterr().err
