"""What samples say about their time: attachments of our own and of both forms of rmw_zenoh, and headers of ROS."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import pytest

from contextpolicy.streams.attachment import attach, source_timestamp
from robotkit import ros
from robotkit.stamps import NOTHING, attached, attachment, header_stamp, ros_attachment

STAMP = 1_795_300_000_123_456_789
GID = bytes(range(16))
POSE = "geometry_msgs/msg/PoseStamped"


def named(sequence=1, stamp=STAMP, gid=GID):
    """As rmw_zenoh wrote it before 2025: a name, behind its length, before each value."""
    parts = ((b"sequence_number", struct.pack("<q", sequence)), (b"source_timestamp", struct.pack("<q", stamp)))
    written = b"".join(bytes([len(name)]) + name + value for name, value in parts)
    return written + bytes([10]) + b"source_gid" + bytes([len(gid)]) + gid


def said(raw):
    sample: Any = SimpleNamespace(attachment=None if raw is None else SimpleNamespace(to_bytes=lambda: raw))
    return attached(sample)


@pytest.mark.parametrize("raw", [named(), ros_attachment(1, STAMP, GID), attachment(STAMP)])
def test_the_stamp_is_read_from_each_form(raw):
    assert said(raw).stamp == STAMP


def test_attachment_formats_match_those_of_the_operator():
    assert ros_attachment(1, STAMP, GID) == attach(1, STAMP, GID)
    assert len(named()) == 77
    assert source_timestamp(named()) == source_timestamp(ros_attachment(1, STAMP, GID)) == STAMP / 1e9


@pytest.mark.parametrize(
    "raw",
    [None, b"", named().replace(b"gid", b"gip"), named(gid=GID[:8] + bytes(8))[:-8], ros_attachment(1, 5, GID)[:-1]],
)
def test_other_attachments_are_ignored(raw):
    assert said(raw) == NOTHING


@pytest.mark.parametrize("stamp", [-1, -(2**63), 2**31 * 10**9, 2**63 - 1])
def test_a_stamp_out_of_range_is_rejected(stamp):
    assert said(ros_attachment(1, stamp, GID)) == said(named(stamp=stamp)) == said(attachment(stamp)) == NOTHING
    assert said(attachment(stamp, b"frame")).fits(b"frame")
    assert not said(attachment(stamp, b"frame")).fits(b"other")


def test_the_stamp_is_read_in_both_byte_orders():
    little = ros.encode({}, POSE, stamp=STAMP)
    big = b"\x00\x00\x00\x00" + (STAMP // 10**9).to_bytes(4, "big") + (STAMP % 10**9).to_bytes(4, "big")
    assert (header_stamp(little), header_stamp(big)) == (STAMP, STAMP)
    assert header_stamp(ros.encode({}, POSE, stamp=0)) is None
    assert header_stamp(little[:11]) is None
