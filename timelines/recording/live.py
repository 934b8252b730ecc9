"""`python -m timelines.recording.live --connect tcp/127.0.0.1:7447`: serve the bus to Foxglove over a WebSocket.

Every client of ws://localhost:8765 receives live what a recording would contain: the same layout shows both.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from typing import TYPE_CHECKING, Any

import foxglove

from robotkit.errors import ConfigurationError
from robotkit.session import credentials, endpoints, open_session
from robotkit.termination import stop_on_signals
from timelines.recording.channels import Channel, channel_of, counted, drawn
from timelines.recording.foxglove import shown
from timelines.recording.recorder import BusRecorder
from timelines.recording.ros_topics import RosTopics

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

PORT = 8765
"""Where Foxglove looks for a WebSocket by itself."""


class LiveChannels:
    """Takes what a recorder writes, on one thread."""

    def __init__(self, context: foxglove.Context) -> None:
        self._context, self._topics = context, RosTopics()
        self._channels: dict[Channel, foxglove.Channel] = {}

    def heard(self, key: str, encoding: str, payload: bytes, *, received: int, stamp: int) -> None:
        """Pass a message on, and what can be drawn of it; times are in ns since 1970."""
        channel = channel_of(key, encoding, self._topics)
        self._opened(channel).log(payload, log_time=received)
        for one in shown(key, channel.encoding, payload, stamp):
            self._opened(drawn(one, key)).log(json.dumps(one.value).encode(), log_time=received)

    def counted(self, topic: str, schema: str, value: Mapping[str, Any], at: int) -> None:
        """Pass a measurement on."""
        self._opened(counted(topic, schema)).log(json.dumps(value).encode(), log_time=at)

    def _opened(self, channel: Channel) -> foxglove.Channel:
        if channel not in self._channels:
            known = (
                foxglove.Schema(name=channel.schema, encoding=channel.language, data=channel.text.encode())
                if channel.text
                else None
            )
            self._channels[channel] = foxglove.Channel(
                channel.topic, schema=known, message_encoding=channel.encoding, context=self._context
            )
        return self._channels[channel]


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until SIGINT or SIGTERM; exit code 2 when the bus can't be reached as asked."""
    options, stop = _parser().parse_args(arguments), stop_on_signals()
    try:
        addresses, secret = endpoints({"ZENOH_CONNECT": options.connect}), credentials(os.environ)
        with open_session(addresses, stop, secret=secret) as session:
            if session is None:
                return 0
            context = foxglove.Context()
            server = foxglove.start_server(name="contextpolicy", port=options.port, context=context)
            sys.stdout.write(f"ws://localhost:{server.port}\n")
            sys.stdout.flush()
            with BusRecorder(session, LiveChannels(context)):
                stop.wait()
            server.stop()
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.recording.live", description=__doc__)
    parser.add_argument(
        "--connect", default=os.environ.get("ZENOH_CONNECT", ""), help="router addresses ($ZENOH_CONNECT)"
    )
    parser.add_argument("--port", type=int, default=PORT, help="of the loopback (%(default)s)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
