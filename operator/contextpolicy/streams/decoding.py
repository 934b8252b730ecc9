"""Payload bytes -> samples, by the encoding that the policy declares; DecodeError is all that a bad payload raises.

A payload may have 1 MiB, 32 levels and 10,000 values: conditions read readings, not pictures or point clouds, and the
cost of an expression grows with what it reads. NaN and infinities are values where the encoding has them (a laser
scanner says `inf` for "nothing in range"); JSON has none, so there they are a broken payload.
"""

from __future__ import annotations

import json
import math
from bisect import bisect
from typing import TYPE_CHECKING, Any

import msgspec

from contextpolicy.errors import DecodeError
from contextpolicy.planning.conditions.sample import Sample, as_fields
from contextpolicy.policy.stream_spec import Clock, Encoding, Stream
from contextpolicy.streams.attachment import source_timestamp
from contextpolicy.streams.value_counts import cbor_exceeds, msgpack_exceeds, refused_tag

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_PAYLOAD = 1 << 20
"""Bytes."""
MAX_DEPTH = 32
"""Levels of nested lists and maps."""
MAX_VALUES = 10_000
"""Numbers, texts and keys of one payload, counted over all levels."""
MAX_BITS = 14_284
"""Of an integer: 4300 digits, which is as far as JSON goes here (`sys.int_info`)."""

_PLAIN = frozenset({type(None), bool, int, float, str, bytes})
_MAGNITUDES, _SCALES = (1e11, 1e14, 1e17), (1, 10**3, 10**6, 10**9)
"""Below each magnitude a number is Unix time in s, ms, us, and ns above: 10^11 s is the year 5138, 10^11 ms is 1973."""


class Decoder:
    """Decodes one stream's payloads; DecodeError at construction when its ROS type is unknown."""

    def __init__(self, stream: Stream) -> None:
        self.stream = stream
        self._read = _reader(stream)
        self._path = tuple(stream.timestamp.split(".")) if stream.timestamp else ()
        self.reads_attachment = stream.encoding is Encoding.CDR and not self._path and stream.clock is not Clock.ARRIVAL
        """Whether to take the time of publication from the attachment: many ROS 2 types have no header."""

    def decode(self, payload: bytes, attachment: bytes = b"") -> Sample:
        """One reading; DecodeError names the stream, the encoding and what is wrong."""
        try:
            if len(payload) > MAX_PAYLOAD:
                raise DecodeError(f"has {len(payload)} bytes: expected at most {MAX_PAYLOAD}")  # noqa: TRY301 - named below
            return self.sample(self._read(payload), attachment)
        # Broken JSON, MessagePack and UTF-8 raise ValueError; hostile nesting and lengths the other two.
        except (DecodeError, ValueError, RecursionError, MemoryError) as error:
            raise DecodeError(
                f"stream {self.stream.name}: the {self.stream.encoding} payload {_reason(error)}"
            ) from error

    def sample(self, decoded: object, attachment: bytes = b"") -> Sample:
        """The sample of a decoded payload; DecodeError if its timestamp is not one."""
        fields = as_fields(decoded)
        timestamp = _timestamp(fields, self._path) if self._path else source_timestamp(attachment)
        return Sample(self.stream.name, fields, timestamp)


def seconds(stamp: object) -> float:
    """Unix seconds of a sender's timestamp; DecodeError if it is not one.

    ROS times are maps of sec and nanosec. Numbers are seconds, milliseconds, microseconds or nanoseconds by magnitude.
    """
    if isinstance(stamp, dict):
        whole, parts = _number(stamp.get("sec")), _number(stamp.get("nanosec"))
        if whole is not None and parts is not None:
            return whole + parts / 1e9
    else:
        number = _number(stamp)
        if number is not None:
            return number / _SCALES[bisect(_MAGNITUDES, abs(number))]
    raise DecodeError(f"has the timestamp {_short(stamp)}: expected a number, or a map of sec and nanosec")


def _reader(stream: Stream) -> Callable[[bytes], object]:
    # Each library is loaded by the first stream that needs it: an idle robot's memory is the point of the product.
    match stream.encoding:
        case Encoding.JSON:
            return _read_json
        case Encoding.CBOR:
            return _cbor_reader()
        case Encoding.MSGPACK:
            return _msgpack_reader()
        case Encoding.CDR:
            return _cdr_reader(stream)


def _read_json(payload: bytes) -> object:
    try:
        decoded = _FAST_JSON.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        decoded = _JSON.decode(payload.decode())
    if not is_small(payload):
        _check(decoded)
    return decoded


def is_small(payload: bytes) -> bool:
    """Whether a JSON payload is certainly within all bounds, without a walk; False if a walk has to decide.

    Each level needs a bracket and each further entry a comma, so counting bytes gives an upper bound. An entry of a map
    is two values, its key and its value; a third instead of half leaves room for the first entry of each level.
    """
    levels, commas = payload.count(b"[") + payload.count(b"{"), payload.count(b",")
    return levels < MAX_DEPTH and commas < MAX_VALUES // 3 and len(payload) < MAX_PAYLOAD // 2


def _refuse_constant(name: str) -> object:
    raise DecodeError(f"holds {name}, which is not a JSON number")


def _finite(number: str) -> float:
    if math.isinf(float(number)):
        raise DecodeError(f"holds {_short(number)}, which is larger than any double")
    return float(number)


_FAST_JSON = msgspec.json.Decoder()
"""Takes a quarter of the time. What it accepts has the very same value; it refuses more, such as `"\\ud800"`."""
_JSON = json.JSONDecoder(parse_constant=_refuse_constant, parse_float=_finite)
"""Decides about what the other refuses, in its own words."""


def _cbor_reader() -> Callable[[bytes], object]:
    import cbor2  # noqa: PLC0415

    def read(payload: bytes) -> object:
        _refuse_many(payload, cbor_exceeds)
        try:
            decoded = cbor2.loads(payload, max_depth=MAX_DEPTH + 1, semantic_decoders=_NO_REFERENCES)
        except cbor2.CBORError as error:
            raise _of_cbor(error) from error
        _check(decoded)
        return decoded

    return read


def _refusal(tag: int) -> Callable[[object, object], object]:
    def refuse(_content: object, _immutable: object) -> object:
        raise DecodeError(refused_tag(tag))

    return refuse


_NO_REFERENCES = {tag: _refusal(tag) for tag in (25, 28, 29, 256)}
"""Tags that refer to what was said before. A string of 900 kB and a thousand references to it fit into a payload, and
take 900 MB as soon as something copies the value."""


def _of_cbor(error: Exception) -> DecodeError:
    """Our own refusal, which cbor2 wraps, or what cbor2 says."""
    return error.__cause__ if isinstance(error.__cause__, DecodeError) else DecodeError(f"is malformed: {error}")


def _msgpack_reader() -> Callable[[bytes], object]:
    import ormsgpack  # noqa: PLC0415

    def read(payload: bytes) -> object:
        _refuse_many(payload, msgpack_exceeds)
        decoded = ormsgpack.unpackb(payload)
        _check(decoded)
        return decoded

    return read


def _cdr_reader(stream: Stream) -> Callable[[bytes], object]:
    from contextpolicy.policy.ros_types import store_of  # noqa: PLC0415
    from contextpolicy.streams import cdr  # noqa: PLC0415

    read_message = cdr.reader(stream.type or "", store_of(stream), max_values=MAX_VALUES)

    def read(payload: bytes) -> object:
        decoded = read_message(payload)
        if len(payload) > MAX_VALUES:  # each value takes at least a byte
            _check(decoded)
        return decoded

    return read


def _refuse_many(payload: bytes, exceeds: Callable[[bytes, int], bool]) -> None:
    """Refuse what holds too many values before it takes memory; each takes at least a byte."""
    if len(payload) > MAX_VALUES and exceeds(payload, 2 * MAX_VALUES):
        raise DecodeError(f"holds more than {MAX_VALUES} values")


def _check(decoded: object) -> None:
    """Refuse what is too deep, too large or not plain; goes level by level, so that depth needs no stack."""
    level, depth, values = [decoded], 0, 1
    while level:
        below: list[object] = []
        for value in level:
            values += _size(value)
            if values > MAX_VALUES:
                raise DecodeError(f"holds more than {MAX_VALUES} values")
            if isinstance(value, dict):
                below += value.values()
            elif isinstance(value, list):
                below += value
        depth += bool(below)
        if depth > MAX_DEPTH:
            raise DecodeError(f"nests deeper than {MAX_DEPTH} levels")
        level = below


def _size(value: object) -> int:
    """How many values are directly inside; DecodeError for a type that no plain payload holds."""
    if isinstance(value, dict):
        _check_keys(value)
        return 2 * len(value)
    if isinstance(value, list):
        return len(value)
    if type(value) not in _PLAIN:
        raise DecodeError(f"holds a {type(value).__name__}: expected numbers, strings, lists and maps")
    if type(value) is int and value.bit_length() > MAX_BITS:
        raise DecodeError(f"holds an integer of {value.bit_length()} bits: expected at most {MAX_BITS}")
    return 0


def _check_keys(value: dict[object, object]) -> None:
    for key in value:
        if type(key) is not str:
            raise DecodeError(f"has the key {_short(key)}: expected strings")


def _timestamp(fields: dict[str, Any], path: tuple[str, ...]) -> float | None:
    """The sender's timestamp, in Unix seconds; None for a sample without the field, which is allowed."""
    value: Any = fields
    for name in path:
        if not isinstance(value, dict) or name not in value:
            return None
        value = value[name]
    return seconds(value)


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:  # an integer beyond the floats, which JSON allows
        return math.inf


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _reason(error: BaseException) -> str:
    text = str(error).partition("\n")[0][:200]
    return text if isinstance(error, DecodeError) else f"is malformed: {text}"
