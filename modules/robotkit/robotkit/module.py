"""The module.yaml beside a module's code: its inputs, outputs and needs.

    name: slam
    description: Where the robot is, from stereo pictures.
    inputs:
      stereo: {key: robot/camera/stereo, encoding: stereo-frame, depth: 1}
    outputs:
      pose: {key: robot/slam/pose, encoding: json}
    needs: {cores: 1, memory: 150Mi, deadline: 100ms}
    environment: {RIG_DIR: folder of the cameras' calibration}

`INPUT_<NAME>` and `OUTPUT_<NAME>` in the environment replace a key, or any fields of the entry in braces:
`INPUT_STEREO=robot2/camera/stereo`, `INPUT_IMU="{key: imu/data, encoding: cdr, type: sensor_msgs/msg/Imu}"`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import yaml
import zenoh

from robotkit import quantities
from robotkit.errors import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    Value = TypeVar("Value")

NAME = re.compile(r"[a-z][a-z0-9-]{0,62}")
KINDS = ("pose", "odometry", "scan", "picture")
"""What an output can mean; `ros_outputs` says what each of them can become."""
RELEASES = ("latest", "humble", "jazzy", "kilted", "lyrical")
"""Of ROS 2; `latest` takes the newest definition of each message."""


@dataclass(frozen=True, slots=True)
class Input:
    """A stream that the module reads; its queue keeps the newest `depth` samples.

    `type` is the ROS 2 message type where `encoding` is `cdr`, of the release `ros`, or defined in the folder `types`.
    """

    key: str
    encoding: str = "json"
    type: str = ""
    depth: int = 1
    ros: str = "latest"
    types: str = ""


@dataclass(frozen=True, slots=True)
class Output:
    """A stream that the module publishes; `frame` is the frame_id in a ROS message's header.

    `kind` says what a result means, so that it can become a ROS message (`ros_outputs`); `child_frame` is what an
    Odometry describes.
    """

    key: str
    encoding: str = "json"
    type: str = ""
    frame: str = ""
    kind: str = ""
    child_frame: str = "base_link"
    ros: str = "latest"
    types: str = ""


@dataclass(frozen=True, slots=True)
class Needs:
    """What the task needs to be of any use: cores, memory in bytes, seconds from a sample to its result."""

    cores: float | None = None
    memory: int | None = None
    deadline: float | None = None


@dataclass(frozen=True)
class Module:
    """The content of a module.yaml."""

    name: str
    description: str = ""
    inputs: Mapping[str, Input] = field(default_factory=dict)
    outputs: Mapping[str, Output] = field(default_factory=dict)
    needs: Needs = Needs()
    environment: Mapping[str, str] = field(default_factory=dict)


def load_module(path: Path, environment: Mapping[str, str] | None = None) -> Module:
    """Read a module.yaml; ConfigurationError names every invalid field."""
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from error
    reader = _Reader()
    module = reader.module(_overridden(document, environment or {}, reader))
    if reader.problems:
        raise ConfigurationError("\n".join(f"{path}: {problem}" for problem in reader.problems))
    return module


def _overridden(document: Any, environment: Mapping[str, str], reader: _Reader) -> Any:
    """Replace the file's inputs and outputs by those in the environment."""
    for kind in ("input", "output"):
        entries = document.get(f"{kind}s") if isinstance(document, dict) else None
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            variable = f"{kind}_{name}".upper().replace("-", "_")
            if isinstance(entry, dict) and environment.get(variable):
                fields = reader.override(variable, environment[variable])
                reader.check_meaning(variable, entry, fields, output=kind == "output")
                entry.update(fields)
    return document


_STREAM = ("key", "encoding", "type", "ros", "types")


class _Reader:
    """Reads field by field and collects problems, so that all are reported at once."""

    def __init__(self) -> None:
        self.problems: list[str] = []

    def module(self, document: Any) -> Module:
        fields = self._object("module", document)
        fields = self._known("", fields, {"name", "description", "inputs", "outputs", "needs", "environment"})
        environment = self._object("environment", fields.get("environment") or {})
        for variable, meaning in environment.items():
            if not isinstance(meaning, str):
                self._refuse(f"environment.{variable}", meaning, "a string that explains the variable")
        return Module(
            name=self._text("name", fields.get("name"), NAME, "lower-case letters, digits and dashes"),
            description=str(fields.get("description", "")),
            inputs={name: self._input(name, entry) for name, entry in self._entries("inputs", fields)},
            outputs={name: self._output(name, entry) for name, entry in self._entries("outputs", fields)},
            needs=self._needs(self._object("needs", fields.get("needs") or {})),
            environment={str(name): str(text) for name, text in environment.items()},
        )

    def override(self, variable: str, text: str) -> dict[str, Any]:
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            value = None
        if isinstance(value, dict):
            return value
        if not isinstance(value, str):
            self._refuse(variable, text, "a key, or fields in braces")
        return {"key": text}

    def check_meaning(self, variable: str, entry: dict[str, Any], fields: dict[str, Any], *, output: bool) -> None:
        """Only results whose meaning is known can be made messages of ROS."""
        becomes_ros = fields.get("encoding") == "cdr" and entry.get("encoding", "json") != "cdr"
        if output and becomes_ros and not (entry | fields).get("kind"):
            self._refuse(f"{variable}.encoding", "cdr", "another encoding, or an output with a kind")

    def _input(self, name: str, entry: Any) -> Input:
        path = f"inputs.{name}"
        fields = self._known(path, self._object(path, entry), {*_STREAM, "depth"})
        depth = fields.get("depth", 1)
        if not isinstance(depth, int) or isinstance(depth, bool) or depth < 1:
            self._refuse(f"{path}.depth", depth, "an integer of 1 or more")
            depth = 1
        return Input(**self._stream(path, fields), depth=depth)

    def _output(self, name: str, entry: Any) -> Output:
        path = f"outputs.{name}"
        fields = self._known(path, self._object(path, entry), {*_STREAM, "frame", "kind", "child_frame"})
        kind = fields.get("kind", "")
        if kind not in ("", *KINDS):
            self._refuse(f"{path}.kind", kind, f"one of {', '.join(KINDS)}")
            kind = ""
        frames = {"frame": str(fields.get("frame", "")), "child_frame": str(fields.get("child_frame", "base_link"))}
        return Output(**self._stream(path, fields), **frames, kind=kind)

    def _stream(self, path: str, fields: dict[str, Any]) -> dict[str, str]:
        key = self._key(f"{path}.key", fields.get("key"))
        encoding, kind = str(fields.get("encoding", "json")), str(fields.get("type", ""))
        if (encoding == "cdr") != bool(kind):
            self._refuse(f"{path}.type", kind, "the ROS message type, such as sensor_msgs/msg/Image, of encoding cdr")
        release, types = fields.get("ros", "latest"), str(fields.get("types", ""))
        if release not in RELEASES:
            self._refuse(f"{path}.ros", release, f"one of {', '.join(RELEASES)}")
            release = "latest"
        return {"key": key, "encoding": encoding, "type": kind, "ros": release, "types": types}

    def _needs(self, raw: dict[str, Any]) -> Needs:
        fields = self._known("needs", raw, {"cores", "memory", "deadline"})
        return Needs(
            cores=self._quantity("needs.cores", fields.get("cores"), quantities.cores),
            memory=self._quantity("needs.memory", fields.get("memory"), quantities.memory),
            deadline=self._quantity("needs.deadline", fields.get("deadline"), quantities.duration),
        )

    def _quantity(self, path: str, value: Any, parse: Callable[[str], Value]) -> Value | None:
        try:
            return None if value is None else parse(str(value))
        except ValueError as error:
            self._refuse(path, value, str(error))
            return None

    def _entries(self, name: str, fields: dict[str, Any]) -> list[tuple[str, Any]]:
        entries = self._object(name, fields.get(name) or {})
        for key in entries:
            self._text(name, key, NAME, "names of lower-case letters, digits and dashes")
        return [(str(key), entry) for key, entry in entries.items()]

    def _object(self, path: str, value: Any) -> dict[str, Any]:
        if isinstance(value, dict):
            return value
        self._refuse(path, value, "an object")
        return {}

    def _known(self, path: str, fields: dict[str, Any], known: set[str]) -> dict[str, Any]:
        for name in sorted(map(str, fields.keys() - known)):
            self._refuse(f"{path}.{name}".lstrip("."), fields.get(name), f"only {', '.join(sorted(known))}")
        return fields

    def _text(self, path: str, value: Any, pattern: re.Pattern[str], allowed: str) -> str:
        if isinstance(value, str) and pattern.fullmatch(value):
            return value
        self._refuse(path, value, allowed)
        return ""

    def _key(self, path: str, value: Any) -> str:
        try:
            return str(zenoh.KeyExpr(value))
        except (zenoh.ZError, TypeError, ValueError):
            self._refuse(path, value, "a Zenoh key expression such as robot/camera/stereo")
            return ""

    def _refuse(self, path: str, value: object, allowed: str) -> None:
        self.problems.append(f"{path}: invalid value {value!r}: expected {allowed}")
