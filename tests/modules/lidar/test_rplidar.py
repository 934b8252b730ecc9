from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.lidar import rplidar
from modules.lidar.rplidar import (
    Capsule,
    Command,
    Health,
    Info,
    Node,
    RequestParser,
    capsule_nodes,
    decode_capsule,
    decode_health,
    decode_info,
    decode_node,
    request,
)

BYTE = st.integers(0, 255)
WORD = st.integers(0, 65535)


@pytest.mark.parametrize(
    ("packet", "sequence"),
    [
        (rplidar.STOP, "a5 25"),
        (rplidar.RESET, "a5 40"),
        (rplidar.SCAN, "a5 20"),
        (request(Command.FORCE_SCAN), "a5 21"),
        (rplidar.GET_INFO, "a5 50"),
        (rplidar.GET_HEALTH, "a5 52"),
        (rplidar.EXPRESS_SCAN, "a5 82 05 00 00 00 00 00 22"),
        (rplidar.SCAN_DESCRIPTOR.encode(), "a5 5a 05 00 00 40 81"),
        (rplidar.EXPRESS_DESCRIPTOR.encode(), "a5 5a 54 00 00 40 82"),
        (rplidar.INFO_DESCRIPTOR.encode(), "a5 5a 14 00 00 00 04"),
        (rplidar.HEALTH_DESCRIPTOR.encode(), "a5 5a 03 00 00 00 06"),
    ],
)
def test_the_packets_of_the_data_sheet(packet, sequence):
    assert packet.hex(" ") == sequence


def test_a_node_bit_by_bit():
    # quality 15, S = 1, !S = 0; C = 1; 90 degrees in q6; 1234.5 mm in q2
    assert Node(90.0, 1234.5, 15, start=True).encode() == bytes([15 << 2 | 1, 0x01, 0x2D, 0x4A, 0x13])
    assert decode_node(bytes([0x3D, 0x01, 0x2D, 0x4A, 0x13])) == Node(90.0, 1234.5, 15, start=True)


@pytest.mark.parametrize(
    "data",
    [
        bytes([0b00, 0x01, 0x2D, 0, 0]),  # S == !S
        bytes([0b11, 0x01, 0x2D, 0, 0]),
        bytes([0b01, 0x00, 0x2D, 0, 0]),  # C == 0
        bytes([0b01, 0xFF, 0xFF, 0, 0]),  # 511 degrees
    ],
)
def test_check_bits_refuse_an_invalid_node(data):
    assert decode_node(data) is None


def test_the_error_code_of_the_health_is_little_endian():
    assert decode_health(bytes([2, 0x34, 0x12])) == Health(2, 0x1234)


@given(st.integers(0, 360 * 64 - 1), WORD, st.integers(0, 63), st.booleans())
def test_a_node_is_decoded_as_it_was_encoded(angle, distance, quality, start):
    node = Node(angle / 64, distance / 4, quality, start)
    assert decode_node(node.encode()) == node


@st.composite
def capsules(draw):
    distances = draw(st.lists(st.integers(0, 16383), min_size=32, max_size=32))
    offsets = draw(st.lists(st.integers(0, 63), min_size=32, max_size=32))
    return Capsule(draw(st.integers(0, 360 * 64 - 1)) / 64, tuple(distances), tuple(offsets), draw(st.booleans()))


@given(capsules())
def test_a_capsule_is_decoded_as_it_was_encoded(capsule):
    encoded = capsule.encode()
    assert len(encoded) == rplidar.CAPSULE_SIZE
    assert decode_capsule(encoded) == capsule


@given(capsules(), st.integers(0, 83), st.integers(1, 255))
def test_a_damaged_capsule_is_found(capsule, at, damage):
    encoded = bytearray(capsule.encode())
    encoded[at] ^= damage
    assert decode_capsule(bytes(encoded)) is None


def test_the_samples_of_a_capsule_lie_between_two_start_angles():
    first = Capsule(350.0, (1000,) * 32, (0,) * 32)
    nodes = capsule_nodes(first, Capsule(6.0, (0,) * 32, (0,) * 32))
    assert [node.angle for node in nodes[:3]] == [350.0, 350.5, 351.0]
    assert nodes[-1].angle == 5.5
    assert {node.distance for node in nodes} == {1000.0}


def test_an_offset_turns_a_sample_back():
    first = Capsule(10.0, (1000,) * 32, (8, *(0,) * 31))
    assert capsule_nodes(first, Capsule(26.0, (0,) * 32, (0,) * 32))[0].angle == 9.0


@given(BYTE, BYTE, BYTE, BYTE, st.binary(min_size=16, max_size=16))
def test_the_info_is_decoded_as_it_was_encoded(model, major, minor, hardware, serial):
    info = Info(model, (major, minor), hardware, serial)
    assert decode_info(info.encode()) == info


@given(BYTE, WORD)
def test_the_health_is_decoded_as_it_was_encoded(status, error):
    assert decode_health(Health(status, error).encode()) == Health(status, error)


REQUESTS = st.one_of(
    st.tuples(st.sampled_from([command for command in Command if not command & 0x80]), st.just(b"")),
    st.tuples(st.sampled_from([command for command in Command if command & 0x80]), st.binary(max_size=20)),
)


@given(st.lists(REQUESTS, max_size=6), st.data())
def test_fragmented_requests_are_parsed(sent, data):
    wire = b"".join(request(*each) for each in sent)
    cut = data.draw(st.integers(0, len(wire)))
    parser = RequestParser()
    assert parser.feed(wire[:cut]) + parser.feed(wire[cut:]) == sent


@given(st.binary(max_size=300))
def test_noise_in_requests_is_not_an_error(noise):
    RequestParser().feed(noise)


def test_a_request_with_a_wrong_checksum_is_ignored():
    assert RequestParser().feed(rplidar.EXPRESS_SCAN[:-1] + b"\x23") == []
