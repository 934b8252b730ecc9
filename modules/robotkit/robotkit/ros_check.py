"""What is wrong with a module's use of ROS, before it starts.

Unknown types, keys of another type, results that become no such type, headers without a frame.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from robotkit.errors import ConfigurationError
from robotkit.module import Output
from robotkit.ros_graph import dds_name, type_in
from robotkit.ros_outputs import allowed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from robotkit.module import Input, Module

_ODOMETRY = "nav_msgs/msg/Odometry"
_HASH = re.compile("RIHS01_[0-9a-f]{64}")


def check(module: Module) -> None:
    """ConfigurationError names every entry of encoding `cdr` that can't work."""
    entries: list[tuple[str, Input | Output]] = [(f"inputs.{name}", entry) for name, entry in module.inputs.items()]
    entries += [(f"outputs.{name}", entry) for name, entry in module.outputs.items()]
    problems = [problem for path, entry in entries if entry.encoding == "cdr" for problem in _problems(path, entry)]
    if problems:
        raise ConfigurationError("\n".join(problems))


def _problems(path: str, entry: Input | Output) -> Iterator[str]:
    try:
        from robotkit.ros import is_known  # noqa: PLC0415 - an extra, and megabytes

        known = is_known(entry.type, release=entry.ros, folder=entry.types)
    except ImportError:
        yield f"{path}.encoding: 'cdr' needs the package rosbags: pip install 'robotkit[ros]'"
        return
    except ConfigurationError as error:
        yield f"{path}.{error}"
        return
    if not known:
        further = f" or of {entry.types}" if entry.types else "; `types` names a folder with further ones"
        yield f"{path}.type: invalid value {entry.type!r}: expected a message of ROS 2 {entry.ros}{further}"
        return
    yield from _problems_of_key(path, entry)
    if isinstance(entry, Output):
        yield from _problems_of_output(path, entry)


def _problems_of_key(path: str, entry: Input | Output) -> Iterator[str]:
    """A key of rmw_zenoh names a type and its hash: no subscriber could decode another type there."""
    from robotkit.ros_types import type_store  # noqa: PLC0415 - an extra, and megabytes

    named, type_hash = type_in(entry.key) or (dds_name(entry.type), "")
    known = type_store(entry.ros, entry.types).hash_rihs01(entry.type)
    if named != dds_name(entry.type):
        yield f"{path}.key: invalid value {entry.key!r}: expected a key of {entry.type}, as `type` says"
    elif _HASH.fullmatch(type_hash) and type_hash != known:
        yield (
            f"{path}.key: invalid value {type_hash!r}: expected {known}, the hash of {entry.type} in ROS 2 {entry.ros};"
            " set `ros` to another release, or `types` to a folder with its definition"
        )


def _problems_of_output(path: str, entry: Output) -> Iterator[str]:
    from robotkit.ros import has_header  # noqa: PLC0415 - an extra, and megabytes

    if entry.kind and entry.type not in allowed(entry.kind):
        known = ", ".join(allowed(entry.kind))
        yield f"{path}.type: invalid value {entry.type!r}: expected {known} for an output of kind {entry.kind}"
    frames = {"frame": entry.frame} if has_header(entry.type, release=entry.ros, folder=entry.types) else {}
    if entry.kind and entry.type == _ODOMETRY:
        frames["child_frame"] = entry.child_frame
    for name, frame in frames.items():
        if not frame or frame.startswith("/"):  # tf2 knows neither
            yield f"{path}.{name}: invalid value {frame!r}: expected the id of a frame, such as base_link, without a /"
