"""How MCAP and Foxglove know a topic's messages: its name, their encoding and their schema. Pure."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

from contextpolicy.streams.mcap_recording import DERIVED, HASH, QOS
from timelines.recording.foxglove import schema_of

if TYPE_CHECKING:
    from contextpolicy.streams.recorded_message import Topic
    from timelines.recording.foxglove import Shown
    from timelines.recording.ros_topics import RosTopics


class Channel(NamedTuple):
    """`language` is MCAP's and Foxglove's word for the schema's, `text` is empty where it is unknown."""

    topic: str
    encoding: str
    schema: str = ""
    language: str = ""
    text: str = ""
    metadata: tuple[tuple[str, str], ...] = ()


def channel_of(key: str, encoding: str, topics: RosTopics) -> Channel:
    """The channel of a message of the bus. Of ROS topics it is what rosbag2 writes; of others the topic is the key."""
    topic = topics.of(key)
    if topic is not None:
        return _of_ros(topic)
    return _of_json(key, key) if encoding == "json" else Channel(key, encoding)


def drawn(shown: Shown, key: str) -> Channel:
    """The channel of what a viewer can draw of the messages on a key."""
    return _of_json(shown.topic, shown.schema)._replace(metadata=((DERIVED, key),))


def counted(topic: str, schema: str) -> Channel:
    """The channel of measurements that were never on the bus."""
    return _of_json(topic, schema)


def qos_of(topic: Topic) -> list[Any]:
    """The QoS profiles that publishers of a topic offer, as rosbag2 writes them; empty where unknown."""
    try:
        return list(dump_qos_v9(parse_qos(topic.qos)))
    except (ReaderError, LookupError, TypeError, AttributeError):
        return []


def _of_ros(topic: Topic) -> Channel:
    language = "ros2msg" if topic.definition else ""
    about = ((QOS, json.dumps(qos_of(topic))), (HASH, topic.hash))  # JSON is YAML, which rosbag2 has here
    return Channel(topic.name, topic.encoding, topic.type, language, topic.definition, about)


def _of_json(topic: str, schema: str) -> Channel:
    return Channel(topic, "json", schema, "jsonschema", json.dumps(schema_of(schema)))
