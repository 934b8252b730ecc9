"""An API server with its etcd and nothing else: no scheduler, controller or kubelet touches the objects.

Both are the test node's own program (`make cluster` builds it), on free ports and in a directory of their own.
"""

from __future__ import annotations

import json
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Self

import urllib3
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa

from tests.node import build
from tests.node.layout import CACHE
from tests.ports import free_port

if TYPE_CHECKING:
    from collections.abc import Iterable

TOKEN = "fleet"  # noqa: S105 - of a server that listens on this machine's loopback for some minutes
CLIENTS = 8
START = 120.0
"""Seconds in which the API server must serve."""


class ControlPlane:
    """Everybody who knows the token may do everything."""

    def __init__(self) -> None:
        self._end = ExitStack()
        self._port = free_port()
        self._pool = urllib3.HTTPSConnectionPool(
            "127.0.0.1", self._port, maxsize=CLIENTS, cert_reqs="CERT_NONE", retries=False, timeout=30
        )

    def __enter__(self) -> Self:
        urllib3.disable_warnings(urllib3.exceptions.InsecureRequestWarning)
        self.directory = Path(self._end.enter_context(TemporaryDirectory(prefix="fleet-")))
        etcd, peer = (f"http://127.0.0.1:{free_port()}" for _ in range(2))
        self._start("etcd", *_etcd(self.directory, etcd, peer))
        self._start("kube-apiserver", *_apiserver(self.directory, etcd, self._port))
        self.kubeconfig = self.directory / "kubeconfig"
        authority = self.directory / "serving" / "apiserver.crt"  # the server makes it when it starts
        self.kubeconfig.write_text(json.dumps(_kubeconfig(self._port, authority)), encoding="utf-8")
        self._wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.close()

    def send(self, method: str, path: str, body: Any = None, kind: str = "application/json") -> Any:
        """One request; anything but success is an error."""
        headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": kind}
        content = None if body is None else json.dumps(body)
        answer = self._pool.request(method, path, body=content, headers=headers)
        if answer.status >= 300:
            raise RuntimeError(f"{method} {path}: {answer.data.decode()[:500]}")
        return json.loads(answer.data)

    def send_all(self, requests: Iterable[tuple[Any, ...]]) -> None:
        """Many at once."""
        with ThreadPoolExecutor(CLIENTS) as workers:
            list(workers.map(lambda request: self.send(*request), requests))

    def _start(self, name: str, *arguments: str) -> None:
        program = next(one for one in build.PROGRAMS if one.name == "node")
        binary = CACHE / "bin" / f"node-{build.program_key(program)}" / "node"
        if not binary.exists():
            raise RuntimeError(f"{binary} is not built yet: run `make cluster`")
        log = self._end.enter_context((self.directory / f"{name}.log").open("w"))
        process = subprocess.Popen([str(binary), name, *arguments], stdout=log, stderr=log)
        self._end.callback(_stop, process)

    def _wait(self) -> None:
        deadline = time.monotonic() + START
        while time.monotonic() < deadline:
            try:
                self.send("GET", "/apis/apiextensions.k8s.io/v1/customresourcedefinitions")
            except (urllib3.exceptions.HTTPError, RuntimeError):
                time.sleep(0.5)
            else:
                return
        raise RuntimeError(f"no API server:\n{(self.directory / 'kube-apiserver.log').read_text()[-2000:]}")


def _etcd(directory: Path, client: str, peer: str) -> tuple[str, ...]:
    urls = {
        "listen-client-urls": client,
        "advertise-client-urls": client,
        "listen-peer-urls": peer,
        "initial-advertise-peer-urls": peer,
        "initial-cluster": f"node={peer}",
    }
    data = {"name": "node", "data-dir": directory / "etcd", "unsafe-no-fsync": "true"}
    return tuple(f"--{name}={value}" for name, value in {**urls, **data}.items())


def _apiserver(directory: Path, etcd: str, port: int) -> tuple[str, ...]:
    key = directory / "tokens.key"
    key.write_bytes(
        rsa.generate_private_key(public_exponent=65537, key_size=2048).private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )
    (directory / "tokens.csv").write_text(f"{TOKEN},fleet,fleet,system:masters\n", encoding="utf-8")
    flags = {
        "bind-address": "127.0.0.1",
        "secure-port": port,
        "cert-dir": directory / "serving",
        "etcd-servers": etcd,
        "authorization-mode": "AlwaysAllow",
        "disable-admission-plugins": "ServiceAccount",
        "endpoint-reconciler-type": "none",
        "service-account-issuer": "https://fleet",
        "service-account-key-file": key,
        "service-account-signing-key-file": key,
        "service-cluster-ip-range": "10.0.0.0/24",
        "token-auth-file": directory / "tokens.csv",
    }
    return tuple(f"--{name}={value}" for name, value in flags.items())


def _kubeconfig(port: int, authority: Path) -> dict[str, Any]:
    return {
        "apiVersion": "v1",
        "kind": "Config",
        "current-context": "fleet",
        "clusters": [
            {
                "name": "fleet",
                "cluster": {"server": f"https://127.0.0.1:{port}", "certificate-authority": str(authority)},
            }
        ],
        "users": [{"name": "fleet", "user": {"token": TOKEN}}],
        "contexts": [{"name": "fleet", "context": {"cluster": "fleet", "user": "fleet"}}],
    }


def _stop(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
