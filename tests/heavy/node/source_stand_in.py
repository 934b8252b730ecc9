"""What Flux' source-controller does for a Git repository: each commit becomes an archive on a web server.

The controller itself can't be built here: a Go module that it needs is in no module proxy.
"""

from __future__ import annotations

import functools
import hashlib
import http.server
import json
import subprocess
import threading
from datetime import UTC, datetime

from tests.e2e.cluster import apply, run

GROUP = "source.toolkit.fluxcd.io"
KINDS = {"GitRepository": "gitrepositories", "OCIRepository": "ocirepositories", "Bucket": "buckets"}


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        """The controller's own log says what it fetched."""


def definitions():
    """Of the sources that kustomize-controller watches; whatever is in them."""
    anything = {"type": "object", "x-kubernetes-preserve-unknown-fields": True}
    return [
        {
            "apiVersion": "apiextensions.k8s.io/v1",
            "kind": "CustomResourceDefinition",
            "metadata": {"name": f"{plural}.{GROUP}"},
            "spec": {
                "group": GROUP,
                "scope": "Namespaced",
                "names": {"kind": kind, "plural": plural, "singular": kind.lower()},
                "versions": [
                    {
                        "name": "v1",
                        "served": True,
                        "storage": True,
                        "subresources": {"status": {}},
                        "schema": {
                            "openAPIV3Schema": {"type": "object", "properties": {"spec": anything, "status": anything}}
                        },
                    }
                ],
            },
        }
        for kind, plural in KINDS.items()
    ]


class Repository:
    """A Git repository; what is committed is announced to the cluster as a GitRepository's artifact."""

    def __init__(self, folder, name, namespace):
        self.tree, self._artifacts = folder / "tree", folder / "artifacts"
        self._name, self._namespace = name, namespace
        self.tree.mkdir(parents=True)
        self._artifacts.mkdir()
        handler = functools.partial(Quiet, directory=str(self._artifacts))
        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self._git("init", "--quiet", "--initial-branch=main")

    def close(self):
        self._server.shutdown()
        self._server.server_close()

    def commit(self, message, **files):
        """Write files into the folder policies/ and commit; returns the revision."""
        (self.tree / "policies").mkdir(exist_ok=True)
        for name, content in files.items():
            (self.tree / "policies" / f"{name}.yaml").write_text(json.dumps(content))
        self._git("add", "--all")
        self._git(
            "-c",
            "user.name=fleet",
            "-c",
            "user.email=fleet@example.com",
            "commit",
            "--quiet",
            "--allow-empty",
            "-m",
            message,
        )
        commit = self._git("rev-parse", "HEAD").decode().strip()
        self._announce(f"main@sha1:{commit}", f"{commit}.tar.gz", self._git("archive", "--format=tar.gz", "HEAD"))
        return f"main@sha1:{commit}"

    def _git(self, *arguments):
        return subprocess.run(["git", "-C", self.tree, *arguments], capture_output=True, check=True, timeout=60).stdout

    def _announce(self, revision, file, archive):
        (self._artifacts / file).write_bytes(archive)
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        metadata = {"name": self._name, "namespace": self._namespace}
        artifact = {
            "digest": f"sha256:{hashlib.sha256(archive).hexdigest()}",
            "lastUpdateTime": now,
            "path": file,
            "revision": revision,
            "size": len(archive),
            "url": f"http://127.0.0.1:{self._server.server_port}/{file}",
        }
        ready = {"type": "Ready", "status": "True", "reason": "Stored", "message": revision, "lastTransitionTime": now}
        apply({"apiVersion": f"{GROUP}/v1", "kind": "GitRepository", "metadata": metadata, "spec": {}})
        status = json.dumps({"status": {"artifact": artifact, "conditions": [ready], "observedGeneration": 1}})
        where = ("-n", self._namespace, "--subresource=status", "--type=merge", "--patch", status)
        run("kubectl", "patch", f"gitrepository.{GROUP}", self._name, *where)
