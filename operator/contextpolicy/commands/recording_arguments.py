"""The options that choose a part of a recording, named as in `ros2 bag play`, and reading what they choose."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.commands.robot_arguments import seconds

if TYPE_CHECKING:
    from contextpolicy.policy.definition_files import Definitions
    from contextpolicy.policy.spec import Policy
    from contextpolicy.streams.timeline import Timeline


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    own = parser.add_argument_group(
        "recording", "For a TIMELINE that is an MCAP file, or a folder or .db3 file of rosbag2."
    )
    own.add_argument("--start-offset", type=seconds, default=0.0, metavar="S", help="skip the first S seconds")
    own.add_argument("--playback-duration", type=seconds, metavar="S", help="read S seconds (default: all)")
    own.add_argument(
        "--topics",
        type=topic,
        nargs="+",
        default=(),
        metavar="TOPIC",
        help="read only these topics; /robot/** is allowed",
    )
    own.add_argument("--use-sim-time", action="store_true", help="take the time from the recording's /clock")
    own.add_argument("--skip-damaged", action="store_true", help="skip damaged parts instead of refusing the recording")


def topic(text: str) -> str:
    """A topic or key expression, without the slash that topics of ROS begin with."""
    from contextpolicy.policy.key_expressions import refusal

    reason = refusal(text.strip("/"))
    if reason:
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected a topic or a key expression; {reason}")
    return text.strip("/")


def load_inputs(arguments: argparse.Namespace, policy: Policy, definitions: Definitions) -> Timeline:
    """The timeline, or the recording as one, that the command line names, at the rate that it names."""
    inputs = _load(arguments, policy, definitions)
    return inputs if arguments.rate == 1 else inputs.at_rate(arguments.rate)


def _load(arguments: argparse.Namespace, policy: Policy, definitions: Definitions) -> Timeline:
    from contextpolicy.errors import Finding, SettingsError
    from contextpolicy.streams import recordings, timeline
    from contextpolicy.streams.recorded_message import NO_DAMAGE

    path = Path(arguments.timeline)
    if recordings.is_recording(path):
        excerpt = recordings.Excerpt(
            arguments.start_offset, arguments.playback_duration, arguments.topics, arguments.use_sim_time
        )
        damages = recordings.DamageLog() if arguments.skip_damaged else NO_DAMAGE
        recording = recordings.open_recording(path, excerpt, damages)
        wanted = [stream.key for stream in policy.streams]
        read = recordings.timeline_of(recording, excerpt, recordings.keys_for(policy), name=path.stem, wanted=wanted)
        return replace(read, notes=tuple(damages.notes))
    used = {
        "--start-offset": arguments.start_offset,
        "--playback-duration": arguments.playback_duration,
        "--topics": arguments.topics,
        "--use-sim-time": arguments.use_sim_time,
        "--skip-damaged": arguments.skip_damaged,
    }
    findings = [
        Finding(name, value, "no value, as TIMELINE is not a recording") for name, value in used.items() if value
    ]
    if findings:
        raise SettingsError("arguments", tuple(findings))
    return timeline.load(arguments.timeline, definitions)
