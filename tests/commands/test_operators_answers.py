"""What a command says when the operator's page ends in the middle of an answer, or is none: one sentence."""

from __future__ import annotations

import socket
from threading import Thread
from typing import TYPE_CHECKING

import pytest

from contextpolicy.commands.cluster_access import ClusterAccessError
from contextpolicy.commands.operator_access import asker

if TYPE_CHECKING:
    from collections.abc import Iterator

HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 40\r\n\r\n"
ANSWERS = {
    "killed while it answers": HEAD + b'[{"policy": ',
    "killed before": b"",
    "not HTTP": b"SSH-2.0-OpenSSH_9.7\r\n",
    "not JSON": b"HTTP/1.1 200 OK\r\nContent-Length: 8\r\n\r\n<html/>\n",
    "nested without end": b"HTTP/1.1 200 OK\r\n\r\n" + b"[" * 100_000,
    "another page": b"HTTP/1.1 404 Not Found\r\nContent-Type: text/plain\r\nContent-Length: 13\r\n\r\nnothing here\n",
}
UNKNOWN = b"HTTP/1.1 404 Not Found\r\nContent-Type: application/json\r\nContent-Length: 4\r\n\r\nnull"


@pytest.fixture
def listening() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as opened:
        yield opened


def answer(listening: socket.socket, content: bytes) -> int:
    """Answer one question; returns the port."""

    def once() -> None:
        client, _ = listening.accept()
        with client:
            client.recv(10_000)
            client.sendall(content)

    Thread(target=once, daemon=True).start()
    return int(listening.getsockname()[1])


@pytest.mark.parametrize("situation", ANSWERS)
def test_missing_or_invalid_answer_is_an_error(listening: socket.socket, situation: str) -> None:
    ask = asker(answer(listening, ANSWERS[situation]))
    with pytest.raises(
        ClusterAccessError,
        match=r"^the operator (does not answer|answered with an error): .+; see `doctor`, or try again$",
    ):
        ask("boards")


def test_unknown_policy_has_no_answer(listening: socket.socket) -> None:
    assert asker(answer(listening, UNKNOWN))("explanation", policy="lab/robot") is None
