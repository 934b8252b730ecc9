"""The live page over real HTTP on the loopback."""

from __future__ import annotations

import gzip
import http.client
import json
import re
import socket
import threading
from importlib.resources import files
from queue import SimpleQueue

import pytest

from contextpolicy.live import page_server
from contextpolicy.live.page_server import ASSETS, AT_ONCE, PageServer, packed
from tests.waiting import PATIENCE


class Watched:
    """An operator with one policy."""

    def __init__(self):
        self.asked = []
        self.hold = threading.Event()
        self.hold.set()
        self.entered = threading.Semaphore(0)
        self.hangs = False

    def boards(self):
        if self.hangs:
            raise TimeoutError
        self.entered.release()
        self.hold.wait(PATIENCE)
        return [{"policy": "lab/robot"}]

    def plans(self, policy, since):
        self.asked.append((policy, since))
        return []

    def explanation(self, policy):
        return {"policy": policy} if policy == "lab/robot" else None

    def recording(self, policy, last):
        self.asked.append((policy, last))
        return {}


@pytest.fixture
def watched():
    return Watched()


@pytest.fixture
def server(watched):
    opened = PageServer(0, watched)
    opened.start()
    yield opened
    opened.close()


@pytest.fixture
def get(server):
    def ask(path, method="GET", host="localhost"):
        connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE)
        connection.request(method, path, headers={"Host": host})
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        return answer.status, body.decode(), answer.headers

    return ask


def test_it_listens_on_the_loopback_only(server):
    assert server.server_address[0] == "127.0.0.1"


def test_the_page_and_its_assets(get):
    for path, (_, kind) in ASSETS.items():
        status, _, headers = get(path)
        assert (status, headers["Content-Type"]) == (200, kind)
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert headers["Server"] == "contextpolicy"


def test_page_loads_nothing_external():
    """A robot is offline."""
    for name, _ in ASSETS.values():
        text = files("contextpolicy.live").joinpath(name).read_text(encoding="utf-8")
        assert set(re.findall(r"\w+://[^\"'\s)]+", text)) <= {"http://www.w3.org/2000/svg"}


def test_questions_reach_the_operator(get, watched):
    assert json.loads(get("/api/boards")[1]) == [{"policy": "lab/robot"}]
    assert json.loads(get("/api/plans?policy=lab%2Frobot&since=7.5")[1]) == []
    assert json.loads(get("/api/recording?policy=lab/robot&last=60")[1]) == {}
    assert json.loads(get("/api/explanation?policy=lab/robot")[1]) == {"policy": "lab/robot"}
    assert watched.asked == [("lab/robot", 7.5), ("lab/robot", 60.0)]


@pytest.mark.parametrize(
    ("path", "status", "expected"),
    [
        ("/api/plans?policy=robot", 400, "NAMESPACE/NAME"),
        ("/api/plans?policy=lab/robot&since=noon", 400, "since: invalid value 'noon': expected a number of seconds"),
        *(
            (f"/api/{question}={value}", 400, "expected a number of seconds, at least 0")
            for question in ("plans?policy=lab/robot&since", "recording?policy=lab/robot&last")
            for value in ("nan", "inf", "-1", "1e999")
        ),
        ("/api/explanation?policy=lab/other", 404, "null"),
        ("/api/secrets", 404, "nothing here"),
        ("/../settings.py", 404, "nothing here"),
    ],
)
def test_invalid_questions(get, path, status, expected):
    answer = get(path)
    assert (answer[0], expected in answer[1]) == (status, True)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "<script>"])
def test_other_methods_are_rejected(get, method):
    status, body, headers = get("/api/boards", method)
    assert (status, headers["Content-Type"], headers["Connection"]) == (501, "text/plain", "close")
    assert body == "expected GET or HEAD\n"
    assert "default-src 'none'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    ("request_line", "status"),
    [
        (b"GET /api/boards HTTP/9.1", 505),
        (b"GET /api/boards HTTP/x", 400),
        (b"G E T /", 400),
        (b"GET http://[x HTTP/1.1\r\nHost: localhost", 400),
    ],
    ids=["version", "no version", "words", "no address"],
)
def test_malformed_request_gets_a_one_line_answer(server, request_line, status):
    with socket.create_connection(("127.0.0.1", server.server_port), PATIENCE) as client:
        client.sendall(request_line + b"\r\n\r\n")
        head, body = client.makefile("rb").read().split(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 %d " % status)
    assert b"Content-Type: text/plain" in head
    assert (body.count(b"\n"), b"<" in body) == (1, False)


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost:8082", 200),
        ("127.0.0.1:1", 200),
        ("[::1]:8082", 200),
        ("evil.example", 403),
        ("localhost.evil.example", 403),
        ("[::1", 403),
        ("", 403),
    ],
)
def test_dns_rebinding_is_rejected(get, host, status):
    assert get("/api/boards", host=host)[0] == status


def test_an_operator_that_hangs_is_reported(get, watched):
    watched.hangs = True
    assert get("/api/boards")[0] == 504


def test_an_operator_that_fails_is_reported_as_such(get, watched, caplog):
    """Without an answer the page would say that no operator runs."""
    boards: dict[str, str] = {}
    watched.boards = lambda: boards["lab/robot"]
    status, body, headers = get("/api/boards")
    assert (status, headers["Content-Type"]) == (500, "text/plain")
    assert body == "the operator failed: its log says why\n"
    assert [record.exc_info[0] for record in caplog.records if record.exc_info] == [KeyError]


def test_head_returns_the_same_headers_without_a_body(get):
    for path in (*ASSETS, "/api/boards", "/api/secrets"):
        status, body, headers = get(path, "HEAD")
        whole = get(path)
        assert (status, body) == (whole[0], "")
        assert headers["Content-Length"] == str(len(whole[1].encode()))
        assert headers["Content-Security-Policy"] == whole[2]["Content-Security-Policy"]


def test_the_page_stays_small():
    """It comes through a port-forward, perhaps over a robot's radio."""
    assert sum(len(packed(name)) for name, _ in ASSETS.values()) <= 17_000


def test_page_is_served_gzipped(server):
    for path, (name, _) in ASSETS.items():
        connection = http.client.HTTPConnection("localhost", server.server_port, timeout=PATIENCE)
        connection.request("GET", path, headers={"Accept-Encoding": "gzip, br"})
        answer = connection.getresponse()
        assert answer.headers["Content-Encoding"] == "gzip"
        assert gzip.decompress(answer.read()) == files("contextpolicy.live").joinpath(name).read_bytes()
        connection.close()


def test_excess_request_waits_for_a_free_slot(get, watched):
    watched.hold.clear()
    statuses: SimpleQueue[int] = SimpleQueue()
    for place in range(1, AT_ONCE + 2):
        threading.Thread(target=lambda: statuses.put(get("/api/boards")[0]), daemon=True).start()
        watched.entered.acquire(timeout=PATIENCE if place <= AT_ONCE else 0.1)
    watched.hold.set()
    assert {statuses.get(timeout=PATIENCE) for _ in range(AT_ONCE + 1)} == {200}


def test_too_many_concurrent_requests_get_503(get, watched, monkeypatch):
    monkeypatch.setattr(page_server, "QUEUE", 0.0)
    watched.hold.clear()
    waiting = [threading.Thread(target=get, args=["/api/boards"]) for _ in range(AT_ONCE)]
    for one in waiting:
        one.start()
    statuses = {200}
    while 503 not in statuses:
        statuses = {get("/api/explanation?policy=lab/robot")[0]}
    assert get("/page.js")[0] == 200, "a page without its script would stay empty for good"
    watched.hold.set()
    for one in waiting:
        one.join(PATIENCE)
    assert get("/api/boards")[0] == 200
