"""`docker update --cpus`: the mechanism of the paper, as a command and as a request to the daemon."""

from __future__ import annotations

import http.client
import json
import socket
import time
from itertools import cycle
from typing import TYPE_CHECKING

from tests.bench.reaction.stopwatch import MissedError

if TYPE_CHECKING:
    from tests.bench.reaction.dockerd import Docker
    from tests.bench.reaction.stopwatch import Stopwatch

CORES = (0.1, 0.2)
PATIENCE = 5.0


class DockerUpdate:
    """The command, as the paper's controller would run it; its start is part of the time."""

    name = "docker update"

    def __init__(self, docker: Docker, stopwatch: Stopwatch) -> None:
        self._docker, self._stopwatch, self._next = docker, stopwatch, cycle(CORES)
        self._group = docker.group()
        stopwatch.watch(self._group)

    def go(self) -> dict[str, float]:
        """Milliseconds to each stage."""
        cores = next(self._next)
        began = time.time()
        self._update(cores)
        seen = self._stopwatch.wait({self._group: cores}, began, PATIENCE)
        return {"cgroup": (seen[self._group] - began) * 1e3}

    def close(self) -> None:
        """The container goes with the daemon."""

    def _update(self, cores: float) -> None:
        self._docker.command("update", f"--cpus={cores}", self._docker.container)


class DockerRequest(DockerUpdate):
    """The same without the command: one request to the daemon over a connection that is kept open."""

    name = "docker update by API"

    def __init__(self, docker: Docker, stopwatch: Stopwatch) -> None:
        super().__init__(docker, stopwatch)
        self._connection = http.client.HTTPConnection("localhost", timeout=PATIENCE)
        self._connection.sock = socket.socket(socket.AF_UNIX)
        self._connection.sock.connect(str(docker.socket))

    def close(self) -> None:
        """Give the connection back."""
        self._connection.close()

    def _update(self, cores: float) -> None:
        body = json.dumps({"NanoCpus": round(cores * 1e9)})
        headers = {"Content-Type": "application/json"}
        self._connection.request("POST", f"/containers/{self._docker.container}/update", body, headers)
        answer = self._connection.getresponse()
        said = answer.read()
        if answer.status != 200:
            raise MissedError(f"docker: HTTP {answer.status}: {said[:300]!r}")
