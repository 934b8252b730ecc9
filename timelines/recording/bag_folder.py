"""A folder as `ros2 bag record --storage mcap` writes it, with the messages of ROS; what else is heard is beside them.

rosbag2 plays no bag in which anything is not CDR, so the rest (plans, results, the kernel's counters) has a file of its
own in the folder, bus.mcap, which metadata.yaml does not name.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, Self

import yaml

from contextpolicy.streams.recorded_message import RecordingError
from timelines.recording.channels import qos_of
from timelines.recording.mcap_file import ROS, McapWriter

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from contextpolicy.streams.recorded_message import Topic
    from timelines.recording.ros_topics import RosTopics

OTHERS = "bus.mcap"
VERSION = 9
"""Of rosbag2's metadata: that of ROS 2 Jazzy and later."""


class BagWriter:
    """Writes one folder; use it in a `with` block, from one thread. RecordingError if the folder exists."""

    def __init__(self, path: Path, topics: RosTopics) -> None:
        if path.exists():
            raise RecordingError(f"{path} already exists: expected a new folder, or a file name that ends in .mcap")
        self._path, self._topics = path, topics
        self._file = f"{path.name}_0.mcap"
        # Of ROS from the start: a power cut may leave it as it begins.
        self._ros, self._others = McapWriter(path / self._file, topics, ROS), McapWriter(path / OTHERS, topics)
        self._counts: Counter[Topic] = Counter()
        self._begin = self._end = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        about = self._about()
        self._ros.describe({"serialized_metadata": yaml.safe_dump(about)}, "rosbag2")
        self._ros.close()
        self._others.close()
        text = yaml.safe_dump({"rosbag2_bagfile_information": about}, sort_keys=False)
        (self._path / "metadata.yaml").write_text(text, encoding="utf-8")

    def heard(self, key: str, encoding: str, payload: bytes, *, received: int, stamp: int) -> None:
        """Write a message of the bus; times are in ns since 1970."""
        topic = self._topics.of(key)
        if topic is None:
            self._others.heard(key, encoding, payload, received=received, stamp=stamp)
            return
        self._ros.heard(key, encoding, payload, received=received, stamp=stamp)
        self._begin = min(self._begin, received) if self._counts else received
        self._end = max(self._end, received)
        self._counts[topic] += 1

    def counted(self, topic: str, schema: str, value: Mapping[str, Any], at: int) -> None:
        """Write a measurement that was never on the bus."""
        self._others.counted(topic, schema, value, at)

    def attach(self, name: str, media_type: str, content: bytes, at: int) -> None:
        """Add a whole file, such as the timeline."""
        self._others.attach(name, media_type, content, at)

    def describe(self, about: Mapping[str, str]) -> None:
        """Say what the recording is of."""
        self._others.describe(about)

    def _about(self) -> dict[str, Any]:
        span = {
            "starting_time": {"nanoseconds_since_epoch": self._begin},
            "duration": {"nanoseconds": self._end - self._begin},
            "message_count": self._counts.total(),
        }
        return {
            "version": VERSION,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": [_counted(topic, count) for topic, count in self._counts.items()],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._file],
            "files": [{"path": self._file, **span}],
            "custom_data": None,
            "ros_distro": "unknown",
        }


def _counted(topic: Topic, count: int) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type,
            "serialization_format": topic.encoding,
            "offered_qos_profiles": qos_of(topic),
            "type_description_hash": topic.hash,
        },
        "message_count": count,
    }
