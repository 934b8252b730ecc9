"""`python -m timelines.datasets [NAME ...]`: make the recordings that timelines play."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from modules.speech.synthesis import SpeechError
from timelines.datasets.recordings import RECORDINGS, ROOT, make, of_scenario
from timelines.scenarios.scenario import shipped

if TYPE_CHECKING:
    from collections.abc import Mapping

    from timelines.datasets.recordings import Progress, Recording


def main(arguments: list[str] | None = None) -> int:
    """Make each recording asked for; those that are up to date cost nothing."""
    known = {**RECORDINGS, **_of_scenarios()}
    parser = _parser(known)
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.names) - known.keys())
    if unknown:
        parser.error(f"unknown recording {', '.join(unknown)}: expected one of {', '.join(known)}")
    try:
        make_all(options.root, {name: known[name] for name in options.names or RECORDINGS})
    except SpeechError as error:
        sys.stderr.write(f"\n{error}\n")
        return 1
    return 0


def make_all(root: Path, recordings: Mapping[str, Recording]) -> None:
    """Make each recording, and print its name."""
    for name, recording in recordings.items():
        made = make(root, name, recording, _progress(name))
        sys.stdout.write(f"{root / name}: {'made' if made else 'up to date'}\n")


def _of_scenarios() -> dict[str, Recording]:
    return {name: made for scenario in shipped().values() for name, made in of_scenario(scenario).items()}


def _parser(known: Mapping[str, Recording]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.datasets", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(known)} (those of the demo)")
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
