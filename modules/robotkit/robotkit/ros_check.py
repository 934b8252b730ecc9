"""What is wrong with a module's use of ROS, before it starts: unknown types, results that become no such type."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotkit.errors import ConfigurationError
from robotkit.module import Output
from robotkit.ros_outputs import allowed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from robotkit.module import Input, Module


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
    elif isinstance(entry, Output) and entry.kind and entry.type not in allowed(entry.kind):
        yield f"{path}.type: invalid value {entry.type!r}: a {entry.kind} becomes {', '.join(allowed(entry.kind))}"
