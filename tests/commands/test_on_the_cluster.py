"""Commands that steer and show policies of a cluster, on a small API server and an operator's live page."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import pytest
import yaml

from contextpolicy import cli
from contextpolicy.commands import operator_access
from contextpolicy.live.page_server import PageServer
from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.streams import timeline
from tests.cluster.builders import a_pod
from tests.policies.builders import IMU, a_policy, resources
from tests.ports import free_port
from tests.virtual_operator import VirtualOperator

LEASE = "/apis/coordination.k8s.io/v1/namespaces/lab/leases/contextpolicy"
POLICIES = "/apis/contextpolicy.dev/v1alpha1/namespaces/lab/contextpolicies"


class Cluster(ThreadingHTTPServer):
    """Serves one policy, and `others` by name, and keeps what is merged into them; None for one that is deleted."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Api)
        self.policy = {**a_policy(), "status": {}}
        self.others: dict[str, Any] = {}
        self.patches: list[tuple[str, Any]] = []
        self.operators = [an_operator()]
        self.holder = "system/first"
        self.silent = 0
        self.lease_code = 200

    def lease(self):
        """That of the policy's namespace, which was renewed `silent` seconds ago."""
        renewed = datetime.now(UTC) - timedelta(seconds=self.silent)
        spec = {"holderIdentity": self.holder, "leaseDurationSeconds": 60, "renewTime": renewed.isoformat()}
        return {"metadata": {"resourceVersion": "1"}, "spec": spec}


def an_operator(release="system/first", name="operator"):
    """A running pod of this release."""
    environment = [{"name": "LEASE", "value": release}]
    return {
        "metadata": {"namespace": release.partition("/")[0], "name": name},
        "spec": {"containers": [{"env": environment}]},
        "status": {"phase": "Running"},
    }


class Api(BaseHTTPRequestHandler):
    server: Cluster

    def do_GET(self):
        path, policy = self.path.partition("?")[0], self.server.policy
        known = {
            f"{POLICIES}/robot": policy,
            POLICIES: {"items": [policy]},
            "/apis/contextpolicy.dev/v1alpha1/contextpolicies": {"items": [policy]},
            "/api/v1/pods": {"items": self.server.operators},
            LEASE: self.server.lease(),
            **{f"{POLICIES}/{name}": other for name, other in self.server.others.items()},
        }
        self._answer(known.get(path), 200 if path != LEASE else self.server.lease_code)

    def do_PATCH(self):
        patch = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.patches.append((self.path.partition("?")[0], patch))
        self._answer({})

    def do_DELETE(self):
        self.server.patches.append((self.path.partition("?")[0], None))
        self._answer({})

    def _answer(self, found, code=200):
        body = json.dumps({"message": "not found"} if found is None else found).encode()
        self.send_response(404 if found is None else code)
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
    monkeypatch.setattr(operator_access, "_local_port", lambda _: server.server_port)
    monkeypatch.setattr(shutil, "which", lambda _: sys.executable)
    yield started
    server.close()


@pytest.mark.parametrize(("command", "mode"), [("pause", "Paused"), ("dry-run", "DryRun")], ids=lambda value: value)
def test_the_mode(cluster, capsys, command, mode):
    assert cli.main([command, "robot"]) == 0
    assert cluster.patches == [(f"{POLICIES}/robot", {"spec": {"mode": mode}})]
    assert capsys.readouterr().out == f"lab/robot: Enforce -> {mode}\n"


def test_a_mode_already_set_is_not_patched(cluster, capsys):
    assert cli.main(["resume", "lab/robot"]) == 0
    assert cluster.patches == []
    assert capsys.readouterr().out == "lab/robot: already Enforce\n"


def test_a_policy_that_is_not_there(cluster, capsys):
    assert cli.main(["pause", "robt"]) == 2
    assert "policy lab/robt not found: expected one of robot" in capsys.readouterr().err
    assert cluster.patches == []


def test_a_context_is_forced_for_a_while(cluster):
    assert cli.main(["force", "robot", "moving", "--for", "5m"]) == 0
    [(_, patch)] = cluster.patches
    assert patch["spec"]["force"]["context"] == "moving"
    assert patch["spec"]["force"]["until"].endswith("Z")
    assert cli.main(["force", "robot", "--end"]) == 0
    assert cluster.patches[1][1] == {"spec": {"force": None}}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["robot", "movng"], "unknown context 'movng': expected one of moving"),
        (["robot"], "expected either a CONTEXT or --end"),
        (["robot", "moving", "--end"], "expected either a CONTEXT or --end"),
    ],
)
def test_invalid_force_is_refused(cluster, capsys, arguments, expected):
    assert cli.main(["force", *arguments]) == 2
    assert expected in capsys.readouterr().err
    assert cluster.patches == []


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("duration", ["0s", "2d", "soon", "-1m", "25h"])
def test_how_long_a_context_can_be_forced(capsys, duration):
    with pytest.raises(SystemExit):
        cli.main(["force", "robot", "moving", f"--for={duration}"])
    assert "a duration such as 30s or 2h, at most 24h" in capsys.readouterr().err


def test_the_status_for_people_and_programs(cluster, operator, capsys):
    cluster.policy["status"] = operator.cluster.statuses["lab/robot"]
    assert cli.main(["status"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("lab/robot: Ready, context: moving\n  plan 3 since ")
    assert "  slam    8       800m   1\n" in out
    assert cli.main(["status", "robot", "-o", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["contexts"] == ["moving"]
    assert cli.main(["status", "-A", "-o", "yaml"]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["items"][0]["ready"] is True


def test_state_of_a_dead_operator_is_marked_as_old(cluster, operator, capsys):
    cluster.policy["status"], cluster.silent = operator.cluster.statuses["lab/robot"], 86_400 * 3 + 60
    assert cli.main(["status"]) == 1
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first == ("lab/robot: no operator has served namespace lab for 3 days; what follows is its last state")
    assert second == "  Ready, context: moving"
    assert cli.main(["status", "-o", "json"]) == 1
    [found] = json.loads(capsys.readouterr().out)["items"]
    assert (found["served"], found["secondsUnserved"] // 86_400, found["ready"]) == (False, 3, False)


def test_a_lease_that_may_not_be_read_shows_nothing(cluster, operator, capsys):
    cluster.policy["status"], cluster.lease_code = operator.cluster.statuses["lab/robot"], 403
    assert cli.main(["status"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("lab/robot: Ready, context: moving\n  cannot tell whether an operator serves namespace lab")
    assert cli.main(["status", "robot", "-o", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["served"] is None
    assert cli.main(["pause", "robot"]) == 0
    assert "cannot tell whether" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [["force", "robot", "moving"], ["force", "robot", "--end"], ["pause", "robot"], ["resume", "robot"]],
    ids=" ".join,
)
def test_change_without_an_operator_is_written_with_a_warning(cluster, capsys, words):
    cluster.holder = ""
    cluster.policy["spec"] = {**cluster.policy["spec"], "mode": "DryRun"}
    assert cli.main(words) == 1
    assert len(cluster.patches) == 1
    said = capsys.readouterr()
    assert said.err.startswith("warning: no operator has served namespace lab for 0 s; ")
    assert " holds until" not in said.out


@pytest.mark.parametrize(("year", "forced"), [("2999", "moving"), ("2001", None)])
def test_expired_force_is_not_shown(cluster, capsys, year, forced):
    """The field stays in the spec until somebody removes it."""
    cluster.policy["spec"] = {
        **cluster.policy["spec"],
        "force": {"context": "moving", "until": f"{year}-01-01T00:00:00Z"},
    }
    cli.main(["status", "robot", "-o", "json"])
    assert json.loads(capsys.readouterr().out)["forced"] == forced
    cli.main(["status", "robot"])
    assert ("(forced: moving until 2999-01-01T00:00:00Z)" in capsys.readouterr().out) is (forced is not None)


def test_kubeconfig_and_context_select_another_cluster(cluster, tmp_path, capsys, monkeypatch):
    """The default kubeconfig names a cluster that is not there."""
    known = json.loads((tmp_path / "config").read_text())
    far = {"name": "far", "context": {"cluster": "test", "user": "test", "namespace": "lab"}}
    (tmp_path / "other").write_text(json.dumps({**known, "contexts": [*known["contexts"], far]}))
    monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", "/nowhere")
    assert cli.main(["pause", "robot", "--kubeconfig", str(tmp_path / "other"), "--context", "far"]) == 0
    assert cluster.patches == [(f"{POLICIES}/robot", {"spec": {"mode": "Paused"}})]
    assert cli.main(["pause", "robot", "--kubeconfig", str(tmp_path / "other"), "--context", "near"]) == 2
    assert "near" in capsys.readouterr().err
    (tmp_path / "other").write_text("{")
    assert cli.main(["status", "--kubeconfig", str(tmp_path / "other")]) == 2
    assert capsys.readouterr().err.startswith(f"no cluster: {tmp_path / 'other'}: ")
    monkeypatch.delenv("KUBECONFIG", raising=False)
    assert cli.main(["status"]) == 2
    assert capsys.readouterr().err.endswith("found; set KUBECONFIG, or pass --kubeconfig\n")


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["status", "-n", "lab", ""], "robot\n"),
        (["status", "--namespace=lab", "ro"], "robot\n"),
        (["status", "-n", "dock", ""], ""),
        (["status", "--context", "elsewhere", ""], ""),
        (["status", "lab/"], "lab/robot\n"),
        (["explain", "-n", "lab", "robot", ""], "slam\nspeech\n"),
        (["explain", "lab/robot", "sp"], "speech\n"),
        (["force", "robot", "-n", "lab", ""], "moving\n"),
        (["why-not", "robot", "-n", "lab", ""], "moving\n"),
        (["why-not", "robot", "-n", "dock", ""], ""),
        (["pause", "robot", "-n", "lab", ""], ""),
    ],
    ids=str,
)
def test_completion_offers_names_of_the_selected_cluster(tmp_path, monkeypatch, capsys, words, offered):
    """The default kubeconfig names a cluster that is not there."""
    monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", "/nowhere")
    *before, word = words
    assert cli.main(["__complete", *before, "--kubeconfig", str(tmp_path / "config"), word]) == 0
    assert capsys.readouterr().out == offered


@pytest.mark.usefixtures("operator")
@pytest.mark.parametrize("output", ["json", "yaml"])
@pytest.mark.parametrize(
    "words",
    [["status"], ["status", "robot"], ["explain", "robot"], ["why-not", "robot"], ["top", "--once"]],
    ids=" ".join,
)
def test_machine_readable_output_has_a_schema_version(words, output, capsys, monkeypatch):
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    monkeypatch.setattr("contextpolicy.commands.top.TICK", 0.0)
    cli.main([*words, "-o", output])
    text = capsys.readouterr().out
    assert (json.loads(text) if output == "json" else yaml.safe_load(text))["schemaVersion"] == 1


@pytest.mark.usefixtures("operator")
def test_top_shows_the_namespace_that_is_asked_for(capsys, monkeypatch):
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    monkeypatch.setattr("contextpolicy.commands.top.TICK", 0.0)
    assert cli.main(["top", "--once", "-n", "lab", "-o", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["policy"] == "lab/robot"
    assert cli.main(["top", "--once", "-n", "other", "-o", "json"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("command", ["status", "top", "doctor", "restore"])
def test_namespace_and_all_namespaces_are_exclusive(command, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main([command, "-A", "-n", "lab"])
    assert ended.value.code == 2
    assert "not allowed with argument" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["missing", "folder"])
def test_a_kubeconfig_that_cannot_be_read_is_named(tmp_path, monkeypatch, capsys, kind):
    path = tmp_path / kind
    if kind == "folder":
        path.mkdir()
    monkeypatch.setenv("KUBECONFIG", str(path))
    monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", str(path))
    assert cli.main(["status"]) == 2
    assert capsys.readouterr().err.startswith(f"no cluster: {path}: ")


COMMANDS_WITH_FORMATS = ("status", "top", "explain", "why-not", "shadow", "doctor", "restore", "validate", "simulate")


@pytest.mark.parametrize("command", [*COMMANDS_WITH_FORMATS, "suggest", "graph"])
def test_format_help_fits_a_narrow_terminal_and_lists_table(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    with pytest.raises(SystemExit):
        cli.main([command, "--help"])
    text = capsys.readouterr().out
    assert "-o FORMAT, --output FORMAT\n" in text
    assert [line for line in text.splitlines() if "FORMAT" in line and len(line) > 40] == []
    assert command == "graph" or "table" in text


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("words", [["status", "robot", "-A"], ["pause", "lab/robot", "-n", "other"]], ids=" ".join)
def test_name_and_namespace_must_agree(words, capsys):
    assert cli.main(words) == 2
    assert "invalid value " in capsys.readouterr().err


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize(("words", "code"), [(["top"], 0), (["top", "--once"], 130)], ids=str)
def test_top_ends_by_ctrl_c_and_once_is_interrupted_by_it(monkeypatch, words, code):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    monkeypatch.setattr(operator_access, "running", interrupted)
    assert cli.main(words) == code


KUBECTL = ["status", "top", "explain", "why-not", "force", "pause", "shadow", "adopt", "doctor", "record", "restore"]


@pytest.mark.parametrize("command", KUBECTL)
def test_every_command_has_kubectls_options(command, capsys):
    with pytest.raises(SystemExit):
        cli.main([command, "--help"])
    text = capsys.readouterr().out
    for option in ("--context NAME", "--kubeconfig FILE", "-n NS"):
        assert option in text, option


def test_unready_status_exits_1_with_the_reason(cluster, capsys):
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


@pytest.fixture
def forwarded(operator, monkeypatch, tmp_path):  # noqa: ARG001 - what is at the other end
    """The pods that were asked."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    monkeypatch.setattr("contextpolicy.commands.top.TICK", 0.0)
    asked = []
    popen = subprocess.Popen

    def start(argv, **settings):
        asked.append(" ".join(argv[-3:-1]))
        return popen([sys.executable, "-c", ""], **settings)

    monkeypatch.setattr(subprocess, "Popen", start)
    return asked


FIRST, SECOND = "system/first", "canary/second"
WORDS = [["explain", "robot"], ["why-not", "robot"], ["record", "robot"], ["top", "--once", "-n", "lab"]]


@pytest.mark.parametrize("words", WORDS, ids=" ".join)
@pytest.mark.parametrize("holder", [FIRST, SECOND])
def test_the_release_that_serves_the_namespace_is_queried(cluster, forwarded, holder, words):
    """The other may know of other policies, or be a canary configured to leave this namespace alone."""
    cluster.operators, cluster.holder = [an_operator(FIRST), an_operator(SECOND)], holder
    assert cli.main(words) == 0
    assert forwarded == [f"{holder.partition('/')[0]} pod/operator"]


def test_top_queries_every_release_without_a_namespace(cluster, forwarded, capsys):
    """Each serves its own namespaces: one of them alone would pass for all that there is."""
    cluster.operators, cluster.holder = [an_operator(FIRST), an_operator(SECOND)], SECOND
    assert cli.main(["top", "--once", "-o", "json"]) == 0
    assert sorted(forwarded) == ["canary pod/operator", "system pod/operator"]
    assert json.loads(capsys.readouterr().out)["policy"] == "lab/robot", "once, also if both show it"


def test_top_ignores_a_release_that_does_not_serve_the_namespace(cluster, forwarded, capsys):
    cluster.operators, cluster.holder = [an_operator(FIRST), an_operator(SECOND)], "gone/third"
    assert cli.main(["top", "--once", "-o", "json"]) == 0
    assert len(forwarded) == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("words", WORDS, ids=" ".join)
def test_disguised_operator_pod_is_not_queried(cluster, forwarded, words):
    """A tenant's, with all labels and variables of the real one, but in the tenant's namespace."""
    disguised = an_operator(FIRST, name="disguised")
    disguised["metadata"]["namespace"] = "lab"
    cluster.operators, cluster.holder = [disguised, an_operator(FIRST)], FIRST
    assert cli.main(words) == 0
    assert forwarded == ["system pod/operator"]


@pytest.mark.usefixtures("operator")
@pytest.mark.parametrize("words", [*WORDS, ["top", "--once"]], ids=" ".join)
def test_disguised_release_that_does_not_answer_does_not_hide_the_real_one(cluster, forwarded, words, monkeypatch):
    """A tenant's pod under a name of its own: its port is no number, or nothing answers there."""
    tenant, silent = an_operator("lab/fake", name="fake"), an_operator("lab/silent", name="silent")
    tenant["spec"]["containers"][0]["env"].append({"name": "LIVE_PORT", "value": "x"})
    real = operator_access._local_port
    monkeypatch.setattr(
        operator_access, "_local_port", lambda forward: free_port() if "silent" in forwarded[-1] else real(forward)
    )
    cluster.operators, cluster.holder = [tenant, silent, an_operator(FIRST)], FIRST
    assert cli.main(words) == 0
    assert "lab pod/fake" not in forwarded
    assert forwarded[-1] == "system pod/operator"


@pytest.mark.parametrize("answer", [None, {}, 5, ["board"], [{}], [{"policy": 5}], [{"policy": "lab/robot"}]])
def test_disguised_release_that_answers_nonsense_changes_nothing(cluster, forwarded, capsys, monkeypatch, answer):
    real = operator_access.asker

    def asker(port):
        fake = "lab" in forwarded[-1]
        return (lambda *_, **__: answer) if fake else real(port)

    monkeypatch.setattr(operator_access, "asker", asker)
    cluster.operators, cluster.holder = [an_operator("lab/fake"), an_operator(FIRST)], FIRST
    assert cli.main(["top", "--once", "-o", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["policy"] == "lab/robot"


def test_a_namespace_that_no_release_serves_is_reported(cluster, forwarded, capsys):
    cluster.operators, cluster.holder = [an_operator(FIRST), an_operator(SECOND)], "gone/third"
    assert cli.main(["explain", "robot"]) == 2
    assert (
        "namespace lab is served by gone/third: expected one of canary/second, system/first" in capsys.readouterr().err
    )
    assert forwarded == []


@pytest.mark.usefixtures("operator")
@pytest.mark.parametrize("columns", [40, 80, 120])
def test_output_fits_the_terminal(cluster, operator, columns, capsys, monkeypatch):
    message = "pod lab/speech: the ResourceQuota cpu-of-the-lab is used up; raise it, or lower the limit"
    status = operator.cluster.statuses["lab/robot"]
    condition = {"type": "Applied", "status": "False", "reason": "NotApplied", "message": message}
    cluster.policy["status"] = {**status, "conditions": [condition]}
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    monkeypatch.setattr("contextpolicy.commands.top.TICK", 0.0)
    monkeypatch.setenv("COLUMNS", str(columns))
    for words in (["explain", "robot"], ["why-not", "robot", "moving"]):
        assert cli.main(words) in (0, 1)
        out = capsys.readouterr().out
        assert [line for line in out.splitlines() if len(line) > columns] == []
    for words in (["status"], ["top", "--once"]):
        assert cli.main(words) in (0, 1)
        out = capsys.readouterr().out
        assert [line for line in out.splitlines() if len(line.rstrip()) > columns] == []
        assert {"slam", "speech", "800m", "200m"} <= set(out.split())


@pytest.mark.usefixtures("operator")
def test_recording_can_be_replayed(tmp_path, capsys):
    folder = tmp_path / "recorded"
    assert cli.main(["record", "robot", "--to", str(folder)]) == 0
    expected = capsys.readouterr().out
    assert "2 samples" in expected
    assert load_policy(str(folder / "policy.yaml")).reference == "lab/robot"
    assert len(list(timeline.load(folder / "timeline.json").inputs())) == 2
    assert [json.loads(line)["sequence"] for line in (folder / "plans.jsonl").read_text().splitlines()][-1] == 3
    command = expected.splitlines()[-1].split()
    assert command[:2] == ["contextpolicy", "simulate"]
    assert "--node robot-1=1000m" in expected
    assert cli.main(command[1:]) == 0
    assert "800m (8)" in capsys.readouterr().out


@pytest.mark.usefixtures("operator")
def test_recording_an_unknown_policy_suggests_status(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["record", "other"]) == 2
    assert "runs no policy lab/other: `status -A` lists all policies" in capsys.readouterr().err
    assert list(tmp_path.glob("*-recorded")) == []


@pytest.mark.usefixtures("operator")
def test_a_folder_is_not_overwritten(tmp_path, capsys):
    assert cli.main(["record", "robot", "--to", str(tmp_path)]) == 2
    assert "a folder that does not exist yet" in capsys.readouterr().err
