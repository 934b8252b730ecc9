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

from tests.node import build
from tests.node.components import as_flags
from tests.node.layout import CACHE
from tests.node.shell import run
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
        binary = CACHE / "bin" / f"node-{build.program_key(build.NODE)}" / "node"
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


def _etcd(directory: Path, client: str, peer: str) -> list[str]:
    return as_flags(
        name="node",
        data_dir=directory / "etcd",
        unsafe_no_fsync="true",
        listen_client_urls=client,
        advertise_client_urls=client,
        listen_peer_urls=peer,
        initial_advertise_peer_urls=peer,
        initial_cluster=f"node={peer}",
    )


def _apiserver(directory: Path, etcd: str, port: int) -> list[str]:
    key = directory / "tokens.key"
    run(["openssl", "genrsa", "-out", str(key), "2048"])
    (directory / "tokens.csv").write_text(f"{TOKEN},fleet,fleet,system:masters\n", encoding="utf-8")
    return as_flags(
        bind_address="127.0.0.1",
        secure_port=port,
        cert_dir=directory / "serving",
        etcd_servers=etcd,
        authorization_mode="AlwaysAllow",
        disable_admission_plugins="ServiceAccount",
        endpoint_reconciler_type="none",
        service_account_issuer="https://fleet",
        service_account_key_file=key,
        service_account_signing_key_file=key,
        service_cluster_ip_range="10.0.0.0/24",
        token_auth_file=directory / "tokens.csv",
    )


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
