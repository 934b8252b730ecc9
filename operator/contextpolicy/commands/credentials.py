"""`--credentials`, the same for every command that uses the bus."""

from __future__ import annotations

import argparse
import os
from pathlib import Path


def add_credentials(parser: argparse.ArgumentParser) -> None:
    """Declare the option. It takes a path: anyone who may list processes can read a command line."""
    parser.add_argument(
        "--credentials",
        type=directory,
        metavar="DIRECTORY",
        default=os.environ.get("ZENOH_CREDENTIALS") or None,
        help="a Secret's files: ca.crt with tls.crt and tls.key, or with username and password (default: "
        "ZENOH_CREDENTIALS, else the bus is open to all)",
    )


def directory(text: str) -> Path:
    """An existing directory."""
    if not Path(text).is_dir():
        raise argparse.ArgumentTypeError(f"{text} is no directory")
    return Path(text)
