"""The robot's bus as a visitor sees it: open, or with the agent closed to everybody without a certificate."""

from __future__ import annotations

import base64
import json
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.bus.session import open_visitor
from timelines.demo import deploy

if TYPE_CHECKING:
    from collections.abc import Iterator

    import zenoh

PATIENCE = 20.0
"""Seconds that the router has to answer."""


@contextmanager
def session(role: str, *, closed: bool) -> Iterator[zenoh.Session]:
    """A session on the bus; where the bus asks who speaks, in the given role."""
    with tempfile.TemporaryDirectory() as folder:
        credentials = _credentials(role, Path(folder)) if closed else None
        endpoint = deploy.router(closed=closed)
        with open_visitor([endpoint], patience=PATIENCE, credentials=credentials) as opened:
            yield opened


def _credentials(role: str, folder: Path) -> Path:
    name = f"contextpolicy-bus-{role}"
    secret = json.loads(deploy.run("kubectl", "get", "secret", name, "-n", deploy.SYSTEM, "-o", "json"))
    for file, content in secret["data"].items():
        (folder / file).write_bytes(base64.b64decode(content))
    return folder
