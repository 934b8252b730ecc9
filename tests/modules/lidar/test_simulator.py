from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.lidar import rplidar
from modules.lidar.rplidar import PROTECTING, Command, Health, decode_health, decode_info, find_answer, request
from modules.lidar.scan import CapsuleParser, NodeParser, Turns, ranges
from modules.lidar.simulator import BOOT_MESSAGE, INFO, ROOM, RplidarA1, seen


def a_lidar(distance=lambda _: 1.0):
    return RplidarA1(distance)


def run(lidar, seconds):
    return b"".join(lidar.advance(lidar.period) for _ in range(round(seconds / lidar.period)))


def body(answer, descriptor):
    return answer[find_answer(answer, descriptor) :]


def test_it_reports_info_and_health():
    lidar = a_lidar()
    assert decode_info(body(lidar.receive(rplidar.GET_INFO), rplidar.INFO_DESCRIPTOR)) == INFO
    assert decode_health(body(lidar.receive(rplidar.GET_HEALTH), rplidar.HEALTH_DESCRIPTOR)) == Health(0, 0)


def configured(entry, *mode):
    """What GET_LIDAR_CONF gives of an entry: of the lidar, or of a mode."""
    payload = struct.pack("<IH", entry, *mode) if mode else struct.pack("<I", entry)
    answer = a_lidar().receive(request(Command.GET_LIDAR_CONF, payload))
    start, size, kind = struct.unpack_from("<2sIB", answer)
    assert (start, kind, len(answer)) == (rplidar.DESCRIPTOR_START, 0x20, 7 + size)
    assert answer[7:11] == payload[:4]
    return answer[11:]


def test_it_reports_its_sample_rates():
    assert a_lidar().receive(request(Command.GET_SAMPLERATE)).hex(" ") == "a5 5a 04 00 00 00 15 f4 01 fa 00"


def test_it_reports_its_scan_modes_as_an_a1_does():
    assert configured(0x70) == struct.pack("<H", 2)
    assert configured(0x7C) == struct.pack("<H", 1)
    assert [configured(0x71, mode) for mode in (0, 1)] == [struct.pack("<I", us * 256) for us in (500, 250)]
    assert [configured(0x74, mode) for mode in (0, 1)] == [struct.pack("<I", 12 * 256)] * 2
    assert [configured(0x75, mode) for mode in (0, 1)] == [b"\x81", b"\x82"]
    assert [configured(0x7F, mode) for mode in (0, 1)] == [b"Standard\0", b"Express\0"]


@pytest.mark.parametrize("asked", [(0x71, 2), (0x99, 0), (0x99,)])
def test_unknown_requests_get_no_answer(asked):
    assert configured(*asked) == b""


@given(st.binary(max_size=40))
def test_any_question_for_its_configuration_has_an_answer(payload):
    assert a_lidar().receive(request(Command.GET_LIDAR_CONF, payload))


def test_it_is_idle_before_a_scan_and_after_a_stop():
    lidar = a_lidar()
    assert run(lidar, 1) == b""
    assert lidar.receive(rplidar.SCAN) == rplidar.SCAN_DESCRIPTOR.encode()
    assert run(lidar, 1) != b""
    assert lidar.receive(rplidar.STOP) == b""
    assert run(lidar, 1) == b""


@pytest.mark.parametrize(
    ("request_", "parser", "rate"), [(rplidar.SCAN, NodeParser, 2000), (rplidar.EXPRESS_SCAN, CapsuleParser, 4000)]
)
def test_it_measures_at_its_rate_and_turns_five_and_a_half_times_a_second(request_, parser, rate):
    lidar = a_lidar()
    lidar.receive(request_)
    nodes = parser().feed(run(lidar, 4))
    assert len(nodes) == pytest.approx(4 * rate, abs=64)
    assert len(Turns().add(nodes)) == pytest.approx(21, abs=1)  # less what precedes the first zero angle


def test_it_fits_on_its_line():
    for request_ in (rplidar.SCAN, rplidar.EXPRESS_SCAN):
        lidar = a_lidar()
        lidar.receive(request_)
        assert len(run(lidar, 1)) <= rplidar.BAUD / 10


@pytest.mark.parametrize(("request_", "parser"), [(rplidar.SCAN, NodeParser), (rplidar.EXPRESS_SCAN, CapsuleParser)])
def test_a_scan_shows_the_room(request_, parser):
    lidar = a_lidar(lambda angle: seen(ROOM, 0, 0, -math.radians(angle)))
    lidar.receive(request_)
    turn = Turns().add(parser().feed(run(lidar, 1)))[0].nodes
    found = ranges(turn)
    assert (found[0], found[90], found[180], found[270]) == pytest.approx((3, 1.5, 2, 1.5), rel=0.01)
    assert sum(map(bool, found)) >= 358  # samples are 0.99 degrees apart


def test_out_of_range_distances_are_zero():
    for metres in (0.1, 12.5, math.inf):
        lidar = a_lidar(lambda _, metres=metres: metres)
        lidar.receive(rplidar.SCAN)
        assert {node.distance for node in NodeParser().feed(run(lidar, 0.1))} == {0}


def test_a_lidar_that_protects_itself_scans_only_after_a_reset():
    lidar = a_lidar()
    lidar.health = Health(PROTECTING, 0x8001)
    assert lidar.receive(rplidar.SCAN) == b""
    assert run(lidar, 0.1) == b""
    assert lidar.receive(rplidar.RESET) == BOOT_MESSAGE
    assert lidar.receive(rplidar.SCAN) == rplidar.SCAN_DESCRIPTOR.encode()


@given(st.binary(max_size=300))
def test_arbitrary_bytes_do_not_crash_it(noise):
    lidar = a_lidar()
    lidar.receive(noise)
    lidar.advance(lidar.period)
