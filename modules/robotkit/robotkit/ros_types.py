"""The ROS 2 message types that a module may name: a release's own, audio_common's, and those of a folder."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from robotkit.errors import ConfigurationError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

HEADER = "std_msgs/msg/Header"
AUDIO = "audio_common_msgs/msg/AudioData"
AUDIO_STAMPED = "audio_common_msgs/msg/AudioDataStamped"
LATEST = "latest"
_AUDIO_DEFINITIONS = {AUDIO: "uint8[] data", AUDIO_STAMPED: f"{HEADER} header\n{AUDIO} audio"}
"""Not among the standard messages: audio_common is a separate package."""
_RELEASES = {
    "humble": Stores.ROS2_HUMBLE,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
    "lyrical": Stores.ROS2_LYRICAL,
}
_UNHASHED = "humble"
"""The release whose types have no hash; rmw_zenoh has a word for that."""
_MSG = re.compile(r"(?:.*/)?([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)\.msg")


@cache
def type_store(release: str = LATEST, folder: str = "") -> Typestore:
    """The messages of a release and those of the .msg and .idl files in and below a folder; ConfigurationError."""
    store = get_typestore(_RELEASES.get(release, Stores.ROS2_LYRICAL))
    if release == LATEST:
        older = get_typestore(Stores.ROS2_KILTED)
        for name in older.fielddefs.keys() - store.fielddefs.keys():  # removed from Lyrical, still used by robots
            store.fielddefs[name], store.types[name] = older.fielddefs[name], older.types[name]
    for name, definition in _AUDIO_DEFINITIONS.items():
        store.register(get_types_from_msg(definition, name))
    if folder:
        _register(store, Path(folder))
    return store


def hash_of(type_name: str, release: str = LATEST, folder: str = "") -> str:
    """The last chunk of the keys on which rmw_zenoh publishes a type."""
    return "TypeHashNotSupported" if release == _UNHASHED else type_store(release, folder).hash_rihs01(type_name)


def _register(store: Typestore, folder: Path) -> None:
    files = sorted(file for file in folder.rglob("*") if file.suffix in (".msg", ".idl"))
    if not files:
        raise ConfigurationError(f"types: invalid value {str(folder)!r}: expected a folder with .msg or .idl files")
    standard = set(store.fielddefs)
    for file in files:
        try:
            text = file.read_text(encoding="utf-8")
            if file.suffix == ".idl":
                store.register(get_types_from_idl(text))
            elif found := _MSG.fullmatch(file.as_posix()):
                store.register(get_types_from_msg(text, f"{found[1]}/msg/{found[2]}"))
        except (OSError, UnicodeDecodeError, TypesysError) as error:
            raise ConfigurationError(f"{file}: cannot be used: {error}") from error
    for name in store.fielddefs.keys() - standard:
        try:
            store.generate_msgdef(name, ros_version=2)
        except TypesysError as error:
            raise ConfigurationError(f"types: {name} can't be used: {error}") from error
