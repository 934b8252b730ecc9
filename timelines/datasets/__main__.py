"""`python -m timelines.datasets [NAME ...]`: make the recordings that timelines play."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from timelines.datasets.recordings import RECORDINGS, ROOT, make
from timelines.datasets.speech import SpeechError

if TYPE_CHECKING:
    from timelines.datasets.recordings import Progress


def main(arguments: list[str] | None = None) -> int:
    """Make each recording asked for; those that are up to date cost nothing."""
    parser = _parser()
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.names) - RECORDINGS.keys())
    if unknown:
        parser.error(f"no recording is called {', '.join(unknown)}; there are {', '.join(RECORDINGS)}")
    for name in options.names or RECORDINGS:
        try:
            made = make(options.root, name, _progress(name))
        except SpeechError as error:
            sys.stderr.write(f"\n{name}: {error}\n")
            return 1
        sys.stdout.write(f"{options.root / name}: {'made' if made else 'up to date'}\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.datasets", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(RECORDINGS))
    parser.add_argument("--root", type=Path, default=ROOT, help="folder of the recordings (%(default)s)")
    return parser


def _progress(name: str) -> Progress:
    """Show progress on one line of a terminal; write nothing into a log."""

    def show(share: float) -> None:
        end = "\n" if share >= 1 else ""
        sys.stderr.write(f"\r{name}: {share:4.0%}{end}")
        sys.stderr.flush()

    return show if sys.stderr.isatty() else lambda _: None


if __name__ == "__main__":
    sys.exit(main())
