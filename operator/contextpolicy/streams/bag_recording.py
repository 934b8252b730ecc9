"""What `ros2 bag record` writes: folders of MCAP or SQLite files, whole or as a power cut leaves them; bare .db3."""

from __future__ import annotations

import heapq
import json
from operator import itemgetter
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import yaml
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import dump_qos_v9

from contextpolicy.streams.recorded_message import (
    Damage,
    Recorded,
    Recording,
    RecordingError,
    Topic,
    amount,
    ros_type,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from rosbags.interfaces import Connection

    from contextpolicy.streams.recorded_message import Damages

    Open = Callable[[Path], Recording]

METADATA = "metadata.yaml"
STORAGES = (".mcap", ".db3")
REINDEX = "`ros2 bag reindex` writes it from the storage files"
RECOVER = "`sqlite3 FILE .recover | sqlite3 NEW.db3` writes what can be read into a new file"


def open_bag(path: Path, open_mcap: Open, damages: Damages) -> Recording:
    """A folder of rosbag2 or one of its .db3 files; `open_mcap` opens an MCAP file."""

    def open_storage(storage: Path) -> Recording:
        return open_mcap(storage) if storage.suffix == ".mcap" else SqliteRecording(storage, damages)

    if not path.is_dir():
        return SqliteRecording(path, damages)
    problem, files = _contents(path)
    if not problem and not files:
        return SqliteRecording(path, damages)
    if not files:
        raise RecordingError(
            f"{path} {problem}, and no storage file ({', '.join(STORAGES)}) is in it: nothing was read"
        )
    joined = JoinedRecording(_readable(files, open_storage, damages))
    if problem:
        count = sum(topic.messages for topic in joined.topics.values())
        damages.add(Damage(str(path), problem, REINDEX, amount(count, joined.begin, joined.end)))
    return joined


def _readable(files: Sequence[Path], open_storage: Open, damages: Damages) -> list[Recording]:
    """The files that can be opened: a power cut leaves the last one of several empty."""
    found = []
    for file in files:
        try:
            found.append(open_storage(file))
        except RecordingError as error:
            if len(files) == 1:
                raise
            what = str(error).removeprefix(str(file)).strip()
            damages.add(Damage(str(file), what, "the bag's other files can be read", "nothing of it was read"))
    return found


def _contents(path: Path) -> tuple[str, list[Path]]:
    """What is wrong with a bag's metadata, and its MCAP files; without either, rosbags reads the folder by itself."""
    there = sorted(file for file in path.iterdir() if file.suffix in STORAGES)
    metadata = path / METADATA
    if not metadata.is_file():
        return f"is a folder without {METADATA}", there
    try:
        about = yaml.safe_load(metadata.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        named = [path / PurePath(str(name)).name for name in about["relative_file_paths"]]
        packed = str(about.get("compression_mode") or "none").lower() != "none"
        in_mcap = about["storage_identifier"] == "mcap"
    except (OSError, UnicodeDecodeError, yaml.YAMLError, LookupError, TypeError, AttributeError) as error:
        return f"has a {METADATA} that can't be read: {_line(error)}", there
    missing = [file.name for file in named if not file.is_file()]
    if missing:
        return f"has a {METADATA} that names files which are not there: {', '.join(missing)}", there
    return "", named if in_mcap and not packed else []


class JoinedRecording:
    """Several files as one recording."""

    def __init__(self, parts: Sequence[Recording]) -> None:
        self._parts = [part for part in parts if part.topics]
        self.begin = min((part.begin for part in self._parts), default=0)
        self.end = max((part.end for part in self._parts), default=0)
        self.topics: dict[str, Topic] = {}
        for part in self._parts:
            for name, topic in part.topics.items():
                before = self.topics[name].messages if name in self.topics else 0
                self.topics[name] = topic._replace(messages=before + topic.messages)

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """In the order of their times."""
        wanted = list(topics)
        return heapq.merge(*(part.messages(wanted, begin, end) for part in self._parts), key=itemgetter(0))


class SqliteRecording:
    """What rosbags reads: a .db3 file, or a folder whose metadata is whole."""

    def __init__(self, path: Path, damages: Damages) -> None:
        self._path, self._damages = path, damages
        if path.is_file() and not path.stat().st_size:
            raise RecordingError(f"{path} is empty: nothing was read, and nothing can be repaired")
        try:
            with Reader(path) as reader:
                self.begin, self.end = reader.start_time, reader.end_time - 1
                found = [_topic(connection) for connection in reader.connections]
        except Exception as error:
            raise RecordingError(f"{path} can't be read: {_line(error)}; nothing was read; {RECOVER}") from error
        self.topics: dict[str, Topic] = {}
        for topic in found:
            before = self.topics[topic.name].messages if topic.name in self.topics else 0
            if topic.messages:
                self.topics[topic.name] = topic._replace(messages=before + topic.messages)

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """In the order of their times, until the file is damaged: nothing can be found behind that."""
        wanted, read, last = set(topics), 0, begin
        try:
            with Reader(self._path) as reader:
                connections = [connection for connection in reader.connections if connection.topic in wanted]
                for connection, at, payload in reader.messages(connections, begin, end + 1) if connections else ():
                    yield Recorded(at, connection.topic, bytes(payload))
                    read, last = read + 1, at
        except Exception as error:  # noqa: BLE001 - third-party parsers on untrusted input
            what = f"is damaged: {_line(error)}"
            self._damages.add(Damage(str(self._path), what, RECOVER, amount(read, begin, last)))


def _topic(connection: Connection) -> Topic:
    ext: Any = connection.ext
    qos = json.dumps(dump_qos_v9(ext.offered_qos_profiles)) if ext.offered_qos_profiles else ""
    definition = connection.msgdef.data if connection.msgdef.format.name == "MSG" else ""
    name, kind = connection.topic, ros_type(connection.msgtype)
    return Topic(name, ext.serialization_format, kind, connection.msgcount, connection.digest, definition, qos)


def _line(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".partition("\n")[0][:160]
