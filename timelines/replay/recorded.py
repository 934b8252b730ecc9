"""A robot's recording (MCAP or rosbag2) as inputs for the player: every payload goes out as it was recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.streams.recordings import Excerpt, bounds, open_recording
from timelines.recording.ros_topics import completed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from contextpolicy.streams.recorded_message import Damages, Topic


class RecordedInputs:
    """The topics that the excerpt wants, on the keys that `key` gives them; RecordingError if it can't be read."""

    def __init__(self, path: Path, excerpt: Excerpt, key: Callable[[Topic], str], damages: Damages) -> None:
        self._recording = open_recording(path, excerpt, damages)
        self._begin, end = bounds(self._recording, Excerpt())
        topics = [_with_hash(topic) for topic in self._recording.topics.values() if excerpt.wants(topic.name)]
        self._keys = {topic.name: key(topic) for topic in topics}
        self.topics = {self._keys[topic.name]: topic for topic in topics if topic.encoding == "cdr"}
        # One nanosecond more, so that the last message is played.
        self.name, self.duration = path.stem, (end - self._begin + 1) / 1e9
        self.encodings = {self._keys[topic.name]: _ENCODINGS.get(topic.encoding, "binary") for topic in topics}

    def timed(self, start: float) -> Iterator[tuple[float, str, bytes]]:
        """Seconds from the recording's begin, key and payload, from `start` on."""
        begin = self._begin + round(start * 1e9)
        for message in self._recording.messages(self._keys, begin, self._recording.end):
            yield (message.at - self._begin) / 1e9, self._keys[message.topic], message.payload


def _with_hash(topic: Topic) -> Topic:
    """A topic as subscriptions of rmw_zenoh look for it: by the hash of its type."""
    return completed(topic) if topic.encoding == "cdr" else topic


_ENCODINGS = {"json": "json", "cdr": "cdr"}
