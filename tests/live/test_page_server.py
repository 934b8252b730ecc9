"""The live page over real HTTP on the loopback."""

from __future__ import annotations

import http.client
import json
import re
import threading
from importlib.resources import files

import pytest

from contextpolicy.live.page_server import ASSETS, AT_ONCE, PageServer
from tests.waiting import PATIENCE


class Watched:
    """An operator with one policy."""

    def __init__(self):
        self.asked = []
        self.hold = threading.Event()
        self.hold.set()
        self.hangs = False

    def boards(self):
        if self.hangs:
            raise TimeoutError
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


def test_it_needs_nothing_from_outside():
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
    ("path", "status", "told"),
    [
        ("/api/plans?policy=robot", 400, "NAMESPACE/NAME"),
        ("/api/plans?policy=lab/robot&since=noon", 400, "since noon is not allowed: a number of seconds"),
        ("/api/explanation?policy=lab/other", 404, "null"),
        ("/api/secrets", 404, "nothing here"),
        ("/../settings.py", 404, "nothing here"),
    ],
)
def test_questions_that_make_no_sense(get, path, status, told):
    answer = get(path)
    assert (answer[0], told in answer[1]) == (status, True)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS"])
def test_it_only_answers(get, method):
    assert get("/api/boards", method)[0] == 501


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
def test_a_page_of_somebody_else_that_points_its_name_here_gets_nothing(get, host, status):
    assert get("/api/boards", host=host)[0] == status


def test_an_operator_that_hangs_is_said(get, watched):
    watched.hangs = True
    assert get("/api/boards")[0] == 504


def test_too_many_at_once_are_sent_away(get, watched):
    watched.hold.clear()
    waiting = [threading.Thread(target=get, args=["/api/boards"]) for _ in range(AT_ONCE)]
    for one in waiting:
        one.start()
    statuses = {200}
    while 503 not in statuses:
        statuses = {get("/")[0]}
    watched.hold.set()
    for one in waiting:
        one.join(PATIENCE)
    assert get("/api/boards")[0] == 200
