"""`python -m timelines.replay TIMELINE --connect tcp/127.0.0.1:7447`: play a timeline, or a recording, on the bus."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.commands.recording_arguments import topic
from contextpolicy.errors import ContextPolicyError
from contextpolicy.policy.definition_files import of_folder
from contextpolicy.streams.recorded_message import NO_DAMAGE
from contextpolicy.streams.recordings import DamageLog, Excerpt, bridge_key, is_recording, timeline_key
from contextpolicy.streams.timeline import load
from robotkit import ConfigurationError
from robotkit.euroc import DatasetError
from robotkit.session import credentials, endpoints, open_session
from robotkit.termination import stop_on_signals
from timelines.datasets.recordings import ROOT
from timelines.recording.bag_folder import BagWriter
from timelines.recording.mcap_file import McapWriter
from timelines.recording.recorder import BusRecorder
from timelines.recording.ros_topics import RosTopics
from timelines.replay.player import Options, TimelineInputs, publish
from timelines.replay.recorded import RecordedInputs

if TYPE_CHECKING:
    import threading

    from timelines.replay.player import Inputs, Report


def main(arguments: list[str] | None = None) -> int:
    """Play until the end, SIGINT or SIGTERM; report what was published and how late."""
    options = _parser().parse_args(arguments)
    options.damages = DamageLog() if options.skip_damaged else NO_DAMAGE
    stop = stop_on_signals()
    try:
        report = _play(_inputs(options), options, stop)
    except (ContextPolicyError, ConfigurationError, DatasetError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except OSError as error:
        sys.stderr.write(f"{options.record or options.timeline}: {error.strerror or error}\n")
        return 1
    for note in options.damages.notes:
        sys.stderr.write(f"note: {note}\n")
    if report is not None:
        sys.stdout.write(_as_json(report) if options.output == "json" else _as_text(report))
    return 0


def _inputs(options: argparse.Namespace) -> Inputs:
    """The timeline with its data sets, or the recording."""
    if is_recording(options.timeline):
        excerpt = Excerpt(topics=options.topics, use_sim_time=options.use_sim_time)
        return RecordedInputs(options.timeline, excerpt, _KEYS[options.ros_keys], options.damages)
    definitions = of_folder(options.types) if options.types else ()
    return TimelineInputs(load(options.timeline, definitions), options.datasets, options.topics)


def _play(inputs: Inputs, options: argparse.Namespace, stop: threading.Event) -> Report | None:
    with open_session(endpoints({"ZENOH_CONNECT": options.connect}), stop, secret=credentials(os.environ)) as session:
        if session is None:
            return None
        chosen = Options(options.rate, options.start_offset, options.playback_duration, options.loop)
        if options.record is None:
            return publish(inputs, session, stop=stop, options=chosen)
        topics = RosTopics(inputs.topics)
        with _recorded(options.record, topics) as file:
            with BusRecorder(session, file, topics=topics):
                report = publish(inputs, session, stop=stop, options=chosen)
            file.describe({name: json.dumps(value) for name, value in report.as_json().items()})
            if options.timeline.is_file() and not is_recording(options.timeline):
                name, content = options.timeline.name, options.timeline.read_bytes()
                file.attach(name, "application/json", content, round(report.started * 1e9))
        if isinstance(file, McapWriter) and file.mixed:
            sys.stderr.write(f"note: {options.record} {_MIXED}\n")
        return report


def _recorded(path: Path, topics: RosTopics) -> McapWriter | BagWriter:
    return McapWriter(path, topics) if path.suffix == ".mcap" else BagWriter(path, topics)


_MIXED = "holds more than ROS messages: open it with Foxglove; for ROS tools, use --record DIR"


_KEYS = {"rmw_zenoh": timeline_key, "bridge": bridge_key}


def _as_json(report: Report) -> str:
    return json.dumps(report.as_json()) + "\n"


def _as_text(report: Report) -> str:
    summary = report.as_json()
    counts = "".join(f"  {key}: {count}\n" for key, count in report.published.items())
    return f"{report.timeline}: lateness in ms {summary['lateness_ms']}\n{counts}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.replay", description=__doc__)
    parser.add_argument("timeline", type=Path, help="a timeline, an MCAP file, or a rosbag2 folder or .db3 file")
    parser.add_argument(
        "--connect", default=os.environ.get("ZENOH_CONNECT", ""), help="router addresses ($ZENOH_CONNECT)"
    )
    parser.add_argument("--datasets", type=Path, default=ROOT, help="folder of the recordings (%(default)s)")
    parser.add_argument("--types", type=Path, metavar="DIR", help="folder with .msg and .idl files of ROS 2 messages")
    parser.add_argument("--rate", type=_positive, default=1.0, help="speed: 2 plays twice as fast (default: 1)")
    parser.add_argument("--start-offset", type=_seconds, default=0.0, help="seconds to skip")
    parser.add_argument("--playback-duration", type=_positive, help="seconds of the timeline to play")
    parser.add_argument("--loop", action="store_true", help="start again at the end")
    parser.add_argument(
        "--topics",
        type=topic,
        nargs="+",
        default=(),
        metavar="TOPIC",
        help="play only these topics; /robot/** is allowed",
    )
    parser.add_argument("--use-sim-time", action="store_true", help="with a recording: take the time from its /clock")
    parser.add_argument(
        "--ros-keys", choices=_KEYS, default="rmw_zenoh", help="with a recording: keys of ROS 2 topics (%(default)s)"
    )
    parser.add_argument(
        "--skip-damaged", action="store_true", help="with a recording: skip damaged parts instead of refusing it"
    )
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FILE.mcap|DIR",
        help="record everything that happens, for Foxglove or as a rosbag2 folder",
    )
    parser.add_argument("--output", choices=("text", "json"), default="text", help="format of the report")
    return parser


def _positive(text: str) -> float:
    number = float(text)
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected a number above 0")
    return number


def _seconds(text: str) -> float:
    number = float(text)
    if not 0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected 0 or more")
    return number


if __name__ == "__main__":
    sys.exit(main())
