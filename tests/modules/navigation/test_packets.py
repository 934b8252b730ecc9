from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation.packets import FRAME_LIMIT, GROUPS, PACKETS, Frame, Reading, StreamParser

RANGES = {"B": (0, 255), "b": (-128, 127), "H": (0, 65535), "h": (-32768, 32767)}
EXAMPLE = bytes([19, 5, 29, 2, 25, 13, 0, 163])
SINGLE = st.sampled_from(sorted(PACKETS))


def values_of(packets):
    members = {member for packet in packets for member in GROUPS.get(packet, (packet,))}
    return st.fixed_dictionaries({member: st.integers(*RANGES[PACKETS[member]]) for member in sorted(members)})


@st.composite
def streams(draw):
    packets = draw(st.lists(SINGLE, min_size=1, max_size=12, unique=True))
    return packets, draw(st.lists(values_of(packets), min_size=1, max_size=4))


def test_the_frame_of_the_specification():
    (values,) = StreamParser([29, 13]).feed(EXAMPLE)
    # The specification's text says 549 (0x0225): it took the decimal 25 for hexadecimal; its checksum needs 25.
    assert values == {29: 2 * 256 + 25, 13: 0}
    assert Frame([29, 13]).encode(values) == EXAMPLE


@pytest.mark.parametrize(
    ("group", "size"),
    [(0, 26), (1, 10), (2, 6), (3, 10), (4, 14), (5, 12), (6, 52), (100, 80), (101, 28), (106, 12), (107, 9)],
)
def test_a_group_has_the_size_that_the_specification_gives(group, size):
    assert Reading([group]).size == size


@given(values_of([100]))
def test_group_100_holds_every_sensor(values):
    reading = Reading([100])
    assert reading.decode(reading.encode(values)) == values


@given(streams())
def test_a_frame_is_decoded_as_it_was_encoded(stream):
    packets, (values, *_) = stream
    frame = Frame(packets)
    encoded = frame.encode(values)
    assert len(encoded) == frame.size
    assert sum(encoded) % 256 == 0
    assert frame.decode(encoded) == values


@given(streams(), st.binary(max_size=60), st.data())
def test_noise_before_and_between_costs_no_frame(stream, noise, data):
    packets, sent = stream
    frame = Frame(packets)
    parser = StreamParser(packets)
    wire = noise.join([b"", *map(frame.encode, sent)])
    cut = data.draw(st.integers(0, len(wire)))
    padding = bytes(frame.size)  # a false header at the very end waits for the bytes it promises
    heard = parser.feed(wire[:cut]) + parser.feed(wire[cut:]) + parser.feed(padding)
    assert [values for values in heard if values in sent] == sent or frame.start in noise + padding


@given(streams(), st.data())
def test_a_lost_byte_costs_one_frame(stream, data):
    packets, (values, *_) = stream
    whole = Frame(packets).encode(values)
    at = data.draw(st.integers(0, len(whole) - 1))
    parser = StreamParser(packets)
    parser.feed(whole[:at] + whole[at + 1 :])
    heard = [found for _ in range(3) for found in parser.feed(whole)]
    assert heard.count(values) >= 2
    assert parser.skipped > 0


@given(st.binary(max_size=500))
def test_noise_is_discarded_without_an_error(noise):
    parser = StreamParser([7, 43, 44])
    parser.feed(noise)
    assert len(parser._buffer) < Frame([7, 43, 44]).size


def test_a_flipped_bit_is_found_by_the_checksum():
    parser = StreamParser([29, 13])
    assert parser.feed(bytes([19, 5, 29, 3, 25, 13, 0, 163])) == []
    assert parser.skipped == len(EXAMPLE)


def test_more_than_the_line_carries_is_refused():
    with pytest.raises(ValueError, match=f"expected at most {FRAME_LIMIT}"):
        Frame([100, 100, 100])


def test_a_packet_that_the_robot_does_not_know_is_refused():
    with pytest.raises(ValueError, match="packet: invalid value 59"):
        Reading([59])
