"""What a terminal changes: tables fit its width, and what takes long shows that it goes on. Elsewhere neither."""

from __future__ import annotations

import os
import shutil
import sys
from contextlib import contextmanager
from threading import Timer
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SOON = 2.0
"""Seconds after which people begin to wonder."""


def columns(stream: TextIO | None = None) -> int | None:
    """How wide a stream (default: standard output) is; None where neither a terminal nor COLUMNS says it."""
    if os.environ.get("COLUMNS", "").isdigit() or (stream or sys.stdout).isatty():
        return shutil.get_terminal_size().columns
    return None


@contextmanager
def progress(until: float, doing: str) -> Iterator[Callable[[float], None] | None]:
    """A function that moves a progress bar on standard error, towards `until`; None if that is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(doing, total=until)
        yield lambda at: bar.update(task, completed=at)


@contextmanager
def waiting(doing: str) -> Iterator[None]:
    """Show what is being done if it takes longer than `SOON`, where standard error is a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    shown = Console(stderr=True).status(f"{doing} ...")
    begin = Timer(SOON, shown.start)
    begin.daemon = True
    begin.start()
    try:
        yield
    finally:
        begin.cancel()
        begin.join()
        shown.stop()
