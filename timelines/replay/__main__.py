"""`python -m timelines.replay TIMELINE --connect tcp/127.0.0.1:7447`: play a timeline on the robot's bus."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
from pathlib import Path

from contextpolicy.errors import DefinitionError, TimelineError
from contextpolicy.policy.definition_files import of_folder
from contextpolicy.streams.timeline import Timeline, load
from robotkit import ConfigurationError
from robotkit.session import credentials, endpoints, open_session
from timelines.datasets.recordings import ROOT
from timelines.replay.player import Options, Report, play


def main(arguments: list[str] | None = None) -> int:
    """Play until the end, SIGINT or SIGTERM; tell what was published and how late."""
    options = _parser().parse_args(arguments)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    try:
        definitions = of_folder(options.types) if options.types else ()
        report = _play(load(options.timeline, definitions), options, stop)
    except (DefinitionError, TimelineError, ConfigurationError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if report is not None:
        sys.stdout.write(_as_json(report) if options.output == "json" else _as_text(report))
    return 0


def _play(timeline: Timeline, options: argparse.Namespace, stop: threading.Event) -> Report | None:
    with open_session(endpoints({"ZENOH_CONNECT": options.connect}), stop, secret=credentials(os.environ)) as session:
        if session is None:
            return None
        chosen = Options(options.rate, options.start_offset, options.playback_duration, options.loop)
        return play(timeline, session, stop=stop, options=chosen, datasets=options.datasets)


def _as_json(report: Report) -> str:
    return json.dumps(report.as_json()) + "\n"


def _as_text(report: Report) -> str:
    summary = report.as_json()
    counts = "".join(f"  {key}: {count}\n" for key, count in report.published.items())
    return f"{report.timeline}: lateness in ms {summary['lateness_ms']}\n{counts}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.replay", description=__doc__)
    parser.add_argument("timeline", type=Path, help="timeline file")
    parser.add_argument(
        "--connect", default=os.environ.get("ZENOH_CONNECT", ""), help="router addresses ($ZENOH_CONNECT)"
    )
    parser.add_argument("--datasets", type=Path, default=ROOT, help="folder of the recordings (%(default)s)")
    parser.add_argument("--types", type=Path, metavar="DIR", help="folder with .msg and .idl files of ROS 2 messages")
    parser.add_argument("--rate", type=_positive, default=1.0, help="2 plays twice as fast")
    parser.add_argument("--start-offset", type=_seconds, default=0.0, help="seconds to skip")
    parser.add_argument("--playback-duration", type=_positive, help="seconds of the timeline to play")
    parser.add_argument("--loop", action="store_true", help="start again at the end")
    parser.add_argument("--output", choices=("text", "json"), default="text", help="format of the report")
    return parser


def _positive(text: str) -> float:
    number = float(text)
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return number


def _seconds(text: str) -> float:
    number = float(text)
    if not 0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not 0 or more")
    return number


if __name__ == "__main__":
    sys.exit(main())
