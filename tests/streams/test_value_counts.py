"""The walk over headers finds the values that the decoders find, for every kind of value."""

from __future__ import annotations

import random
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import cbor2
import ormsgpack
import pytest

from contextpolicy.errors import DecodeError
from contextpolicy.policy.stream_spec import Encoding, Stream
from contextpolicy.streams import decoding
from contextpolicy.streams.decoding import MAX_VALUES, Decoder
from contextpolicy.streams.value_counts import cbor_exceeds, msgpack_exceeds

if TYPE_CHECKING:
    from collections.abc import Callable

LEAVES: list[Any] = [None, True, 0, -1, 200, -100, -200, 70_000, -70_000, 2**40, -(2**40), 1.5, "", "a" * 31, "g" * 99]
LEAVES += ["b" * 300, "c" * 70_000, b"d" * 20, b"e" * 300, b"f" * 70_000]
ENCODINGS: dict[str, tuple[Callable[[Any], bytes], Callable[[bytes, int], bool]]] = {
    "cbor": (cbor2.dumps, cbor_exceeds),
    "msgpack": (ormsgpack.packb, msgpack_exceeds),
}


def some(draw: random.Random, depth: int = 0) -> Any:
    if depth < 4 and draw.random() < 0.5:
        inside = [some(draw, depth + 1) for _ in range(draw.choice([0, 3, 20]))]
        return inside if draw.random() < 0.5 else {f"k{n}": value for n, value in enumerate(inside)}
    return draw.choice(LEAVES)


def count(value: Any) -> int:
    if isinstance(value, dict):
        return 1 + sum(1 + count(one) for one in value.values())
    return 1 + sum(count(one) for one in value) if isinstance(value, list) else 1


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("seed", range(20))
def test_the_count_is_exact(encoding: str, seed: int) -> None:
    encode, exceeds = ENCODINGS[encoding]
    value = [*LEAVES, some(random.Random(seed))]  # noqa: S311 - no secret
    payload = encode(value)
    assert not exceeds(payload, count(value))
    assert exceeds(payload, count(value) - 1)


def test_extensions_and_indefinite_lengths_are_skipped() -> None:
    assert not cbor_exceeds(bytes.fromhex("9f7f6161ff5f4101ffff"), 8)
    assert cbor_exceeds(bytes.fromhex("9f7f6161ff5f4101ffff"), 7)
    long = bytes.fromhex("825b000000000000000161f6")
    assert not cbor_exceeds(long, 3)
    assert cbor_exceeds(long, 2)
    extended = ormsgpack.packb([*(ormsgpack.Ext(1, b"x" * size) for size in (1, 2, 3, 4, 8, 16, 300)), 1])
    assert not msgpack_exceeds(extended, 9)
    assert msgpack_exceeds(extended, 8)


@pytest.mark.parametrize(
    ("encoding", "payload"),
    [
        (Encoding.CBOR, b"\x9a\x00\x00\x4e\x20" + b"\xa0" * 20_000),
        (Encoding.MSGPACK, b"\xdc\x4e\x20" + b"\x80" * 20_000),
    ],
)
def test_too_many_empty_maps_are_refused_before_they_are_built(
    monkeypatch: pytest.MonkeyPatch, encoding: Encoding, payload: bytes
) -> None:
    decoder = Decoder(Stream("imu", "imu", encoding))
    monkeypatch.setattr(decoding, "_check", lambda _: pytest.fail("was decoded"))
    with pytest.raises(DecodeError, match=f"more than {MAX_VALUES} values"):
        decoder.decode(payload)


def test_a_truncated_payload_ends_the_walk() -> None:
    for exceeds in (cbor_exceeds, msgpack_exceeds):
        for head in range(256):
            with suppress(DecodeError):  # a tag that no plain payload has
                assert isinstance(exceeds(bytes([head]), 1), bool)


def test_a_fraction_of_two_large_integers_is_refused_before_it_is_made() -> None:
    part = b"\xc2\x59\x4e\x20" + b"\xff" * 20_000
    with pytest.raises(DecodeError, match="a value of CBOR tag 30"):
        Decoder(Stream("imu", "imu", Encoding.CBOR)).decode(b"\xd8\x1e\x82" + part + part)


def test_an_integer_of_a_megabyte_is_refused() -> None:
    decoder = Decoder(Stream("imu", "imu", Encoding.CBOR))
    assert decoder.decode(cbor2.dumps({"n": 10**30})).value == {"n": 10**30}
    with pytest.raises(DecodeError, match="holds an integer of 7864320 bits: expected at most 14284"):
        decoder.decode(b"\xc2\x5a" + (983_040).to_bytes(4, "big") + b"\xff" * 983_040)
