"""One at a time: the node and the image store belong to the machine, not to one terminal."""

from __future__ import annotations

import fcntl
import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from tests.node.errors import ClusterError
from tests.node.layout import CACHE
from tests.node.shell import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

log = logging.getLogger(__name__)

PATIENCE = 1800.0  # another terminal may be building everything from scratch


@contextmanager
def held(name: str) -> Iterator[None]:
    CACHE.mkdir(parents=True, exist_ok=True)
    path = CACHE / f"{name}.lock"
    with path.open("w") as file:
        if not _taken(file):
            log.info("waiting for another run that uses the %s", name)
            if not wait_until(lambda: _taken(file), timeout=PATIENCE):
                raise ClusterError(f"{path}: another run has held it for {PATIENCE:.0f} s")
        yield


def _taken(file: TextIO) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
