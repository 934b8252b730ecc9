"""`--credentials`, the same for every command that uses the bus."""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path

_ENDPOINT = re.compile(r"[a-z0-9_]+/[^/\s]\S*")


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
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected an existing directory")
    return Path(text)


def connect(text: str) -> str:
    """Zenoh endpoints, comma separated; Zenoh's own refusal would be an internal error."""
    for endpoint in text.split(","):
        if not _ENDPOINT.fullmatch(endpoint):
            expected = "an endpoint such as tcp/192.168.1.2:7447"
            raise argparse.ArgumentTypeError(f"invalid value {endpoint!r}: expected {expected}")
    return text
