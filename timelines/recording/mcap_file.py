"""An MCAP file that grows message by message. Topics are Zenoh keys, so that a recording plays as it was heard."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any, Self

from mcap.writer import CompressionType, Writer

from contextpolicy.policy.ros_types import is_known, type_store
from contextpolicy.streams.recordings import DERIVED
from timelines.recording.foxglove import schema_of, shown

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


class McapWriter:
    """Writes one file; use it in a `with` block, from one thread."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(library="contextpolicy")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def heard(self, key: str, encoding: str, payload: bytes, *, received: int, stamp: int) -> None:
        """Write a message of the bus as it is, and what a viewer can draw of it; times are in ns since 1970."""
        channel = self._channel(key, encoding, schema_for(key, encoding), {})
        self._writer.add_message(channel, received, payload, stamp)
        for drawn in shown(key, payload, stamp):
            own = self._channel(drawn.topic, "json", drawn.schema, {DERIVED: key})
            self._writer.add_message(own, received, json.dumps(drawn.value).encode(), stamp)

    def counted(self, topic: str, schema: str, value: Mapping[str, Any], at: int) -> None:
        """Write a measurement that was never on the bus."""
        channel = self._channel(topic, "json", schema, {})
        self._writer.add_message(channel, at, json.dumps(value).encode(), at)

    def attach(self, name: str, media_type: str, content: bytes, at: int) -> None:
        """Add a whole file, such as the timeline."""
        self._writer.add_attachment(at, at, name, media_type, content)

    def describe(self, about: Mapping[str, str]) -> None:
        """Say what the recording is of."""
        self._writer.add_metadata("contextpolicy", dict(about))

    def _channel(self, topic: str, encoding: str, schema: str, metadata: dict[str, str]) -> int:
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(
                topic, encoding, self._schema(schema) if schema else 0, metadata
            )
        return self._channels[topic]

    def _schema(self, name: str) -> int:
        if name not in self._schemas:
            form, text = definition_of(name)
            self._schemas[name] = self._writer.register_schema(name, form, text.encode()) if text else 0
        return self._schemas[name]


def schema_for(key: str, encoding: str) -> str:
    """The name of the schema of a message of the bus; empty if it has none."""
    return key if encoding == "json" else ros_type_of(key) if encoding == "cdr" else ""


def definition_of(schema: str) -> tuple[str, str]:
    """What MCAP and Foxglove call a schema's language, and its text, empty if nobody knows it."""
    return ("ros2msg", _definition(schema)) if "/msg/" in schema else ("jsonschema", _json_schema(schema))


def ros_type_of(key: str) -> str:
    """The type in a key of rmw_zenoh; empty if there is none."""
    found = _TYPE.search(key)
    return f"{found['package']}/msg/{found['name']}" if found else ""


_TYPE = re.compile(r"(?:^|/)(?P<package>\w+)::msg::dds_::(?P<name>\w+)_(?:/|$)")


def _definition(name: str) -> str:
    """The .msg text of a ROS 2 type with all that it contains; empty for a type that is not standard."""
    store = type_store()
    return store.generate_msgdef(name)[0] if is_known(name, store) else ""


def _json_schema(name: str) -> str:
    return json.dumps(schema_of(name))
