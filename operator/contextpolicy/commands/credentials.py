"""`--credentials`, the same for every command that speaks on the bus."""

from __future__ import annotations

import argparse
import os
from pathlib import Path


def add_credentials(parser: argparse.ArgumentParser) -> None:
    """Declare it; a path, since a secret on the command line is everybody's who may list processes."""
    parser.add_argument(
        "--credentials",
        type=directory,
        metavar="DIRECTORY",
        default=os.environ.get("ZENOH_CREDENTIALS") or None,
        help="a Secret's files: ca.crt with tls.crt and tls.key, or with username and password (default: "
        "ZENOH_CREDENTIALS, else the bus is open to all)",
    )


def directory(text: str) -> Path:
    """A directory that is there."""
    if not Path(text).is_dir():
        raise argparse.ArgumentTypeError(f"{text} is no directory")
    return Path(text)
