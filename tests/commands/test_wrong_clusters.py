"""What commands say of a cluster that is not there, is none, refuses, or has nothing: the documented exit codes."""

from __future__ import annotations

import json
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

from contextpolicy import cli
from tests.ports import free_port

if TYPE_CHECKING:
    from collections.abc import Iterator

API = "/apis/contextpolicy.dev/v1alpha1"
CLUSTER: dict[str, Any] = {
    "/version": {"gitVersion": "v1.36.0"},
    "/api/v1/pods": {"items": []},
    "/api/v1/namespaces/lab/pods": {"items": []},
    "/api/v1/nodes": {"items": []},
}
"""What a cluster without contextpolicy answers."""
NO_POLICIES = CLUSTER | {
    path: {"items": []} for path in (API, f"{API}/contextpolicies", f"{API}/namespaces/lab/contextpolicies")
}


class Situation(NamedTuple):
    """`paths` are answered with their objects, all others with this status and text; status 0: nobody listens."""

    status: int
    text: str
    paths: dict[str, Any] = {}  # noqa: RUF012 - nobody changes it
    said: str = "--context"


NO_SERVER = Situation(0, "")
REFUSALS = {
    "no server": NO_SERVER,
    "another server": Situation(404, "<html>\n<body>404 page not found</body>\n</html>"),
    "another server's login": Situation(200, "<html>\n<body>Welcome</body>\n</html>"),
    "another server's answers": Situation(200, "{}"),
    "not logged in": Situation(401, '{"message": "Unauthorized"}'),
    "no permission": Situation(403, '{"message": "pods is forbidden: User jane cannot list resource pods"}'),
    "broken": Situation(500, '{"message": "etcd is down"}', said="etcd is down (HTTP 500); try again"),
}
NO_DEFINITION = Situation(404, "404 page not found\n", CLUSTER)
EMPTY = Situation(404, '{"message": "not found"}', NO_POLICIES)
COMMANDS: list[list[str]] = [
    ["status"],
    ["status", "robot"],
    ["status", "-A"],
    ["top", "--once"],
    ["explain", "robot"],
    ["why-not", "robot"],
    ["force", "robot", "moving"],
    *([command, "robot"] for command in ("pause", "resume", "dry-run", "promote", "shadow", "adopt", "record")),
    ["doctor"],
    ["restore"],
    ["restore", "-n", "lab", "--dry-run"],
    ["restore", "--remove-finalizers", "--release", "system/first"],
    ["credentials", "viewer", "credentials"],
    ["certificates", "--release", "system/first"],
]
NOTHING_TO_DO = {"status": 0, "status -A": 0} | {" ".join(one): 0 for one in COMMANDS if one[0] == "restore"}
"""Exit codes in an empty cluster; those of other commands are 2."""


class Server(ThreadingHTTPServer):
    """Answers as the situation is."""

    daemon_threads = True
    situation = NO_SERVER


class Handler(BaseHTTPRequestHandler):
    server: Server

    def _answer(self) -> None:
        self.rfile.read(int(self.headers.get("Content-Length", 0)))
        status, text, paths, _ = self.server.situation
        found = paths.get(self.path.partition("?")[0])
        body = (text if found is None else json.dumps(found)).encode()
        self.send_response(status if found is None else 200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    do_GET = do_POST = do_PATCH = do_PUT = do_DELETE = _answer  # noqa: N815 - http.server looks for these names

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with Server(("127.0.0.1", 0), Handler) as opened:
        Thread(target=opened.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        yield opened
        opened.shutdown()


@pytest.fixture
def run(server: Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run a command in a situation: its exit code, what it prints, and its errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)

    def run(situation: Situation, words: list[str]) -> tuple[int, str, str]:
        server.situation = situation
        port = server.server_port if situation.status else free_port()
        config = {
            "current-context": "test",
            "clusters": [{"name": "test", "cluster": {"server": f"http://127.0.0.1:{port}"}}],
            "contexts": [{"name": "test", "context": {"cluster": "test", "user": "test", "namespace": "lab"}}],
            "users": [{"name": "test", "user": {}}],
        }
        (tmp_path / "config").write_text(json.dumps(config))
        monkeypatch.setattr("kubernetes.config.kube_config.KUBE_CONFIG_DEFAULT_LOCATION", str(tmp_path / "config"))
        return cli.main(words), *capsys.readouterr()

    return run


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
@pytest.mark.parametrize("situation", REFUSALS)
def test_api_errors_make_every_command_fail(run: Any, situation: str, words: list[str]) -> None:
    code, out, errors = run(REFUSALS[situation], words)
    assert (code, out) == (2, "")
    *notes, said = [line for line in errors.splitlines() if line != "dry run: nothing was changed"]
    assert all(note.startswith("originals are not checked: ") for note in notes), "one sentence"
    assert REFUSALS[situation].said in said, "and what to do"


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_missing_crd_is_reported_by_every_command(run: Any, words: list[str]) -> None:
    code, out, errors = run(NO_DEFINITION, words)
    assert code == {"doctor": 1, "restore": 0}.get(words[0], 2)
    if words[0] in ("status", "pause", "resume", "dry-run", "promote", "adopt", "force"):
        assert (out, "ContextPolicy is not defined" in errors, "doctor" in errors) == ("", True, True)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_empty_cluster_is_reported_by_every_command(run: Any, words: list[str]) -> None:
    code, out, errors = run(EMPTY, words)
    assert code == NOTHING_TO_DO.get(" ".join(words), 1 if words == ["doctor"] else 2)
    if words[0] == "status" and not code:
        assert out == f"no policies in {'any namespace' if '-A' in words else 'namespace lab'}\n"
    elif code == 2:
        assert (out, errors.count("\n")) == ("", 1)


def test_unreadable_namespace_is_reported_and_others_are_restored(run: Any) -> None:
    """A script that sees 1 would run it again, in vain."""
    closed = Situation(403, '{"message": "pods is forbidden"}', NO_POLICIES)
    for more in ([], ["--remove-finalizers"]):
        code, out, errors = run(closed, ["restore", "-n", "closed", "-n", "lab", "-o", "json", *more])
        unread = [{"namespace": "closed", "error": "Forbidden: pods is forbidden (HTTP 403)"}]
        assert (code, json.loads(out)["unread"]) == (2, unread)
        assert errors.startswith("namespace closed: NOT read: Forbidden: pods is forbidden (HTTP 403)")
