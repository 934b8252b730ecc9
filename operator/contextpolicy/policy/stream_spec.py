"""The streams of a ContextPolicy as frozen values, valid by construction (see `stream_parsing`)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from contextpolicy.policy.field_types import Cel, Seconds


class Encoding(StrEnum):
    """How a stream's payloads are encoded."""

    JSON = "json"
    CBOR = "cbor"
    MSGPACK = "msgpack"
    CDR = "cdr"


class Clock(StrEnum):
    """Whether a sample's stamp may drop it: always, never, or as long as it comes from our clock."""

    AUTO = "Auto"
    SOURCE = "Source"
    ARRIVAL = "Arrival"


class RosRelease(StrEnum):
    """The ROS 2 release that defines the standard messages; `latest` takes the newest definition of each."""

    HUMBLE = "humble"
    JAZZY = "jazzy"
    KILTED = "kilted"
    LYRICAL = "lyrical"
    LATEST = "latest"


class FeatureOp(StrEnum):
    """What a feature computes over its window."""

    MEAN = "mean"
    MIN = "min"
    MAX = "max"
    RATE = "rate"
    COUNT = "count"


MAX_SAMPLES = 10_000
"""A window keeps at most this many samples, the newest ones: 10 s of a 1 kHz sensor."""


@dataclass(frozen=True, slots=True)
class Feature:
    """A number over the samples of the last `over` seconds, read as `stream.name`."""

    name: str
    op: FeatureOp
    over: Seconds
    of: Cel | None = None


@dataclass(frozen=True, slots=True)
class Stream:
    """A Zenoh key expression whose samples the policy reads.

    `types` names the ConfigMap of further message definitions; `definitions` are its files as (name, text), None
    until they are read.
    """

    name: str
    key: str
    encoding: Encoding = Encoding.JSON
    type: str | None = None
    ros: RosRelease = RosRelease.LATEST
    types: str | None = None
    definitions: tuple[tuple[str, str], ...] | None = None
    stale_after: Seconds | None = None
    liveliness: str | None = None
    fallback: str | None = None
    """The context that holds while the stream is silent, instead of the policy's fallback."""
    timestamp: str | None = None
    clock: Clock = Clock.AUTO
    filter: Cel | None = None
    sources: int = 0
    """How many sources to keep apart by what the key's wildcards match; 0: only the latest sample of all counts."""
    debounce: Seconds = 0.0
    sample_every: Seconds = 0.0
    produced_by: str | None = None
    example: object = None
    """A sample as the stream's sender writes it, decoded: what expressions are checked against. None where unknown."""
    features: tuple[Feature, ...] = ()
