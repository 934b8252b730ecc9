"""The backlog of the loop stays bounded, however much is sent on however many streams."""

from __future__ import annotations

from contextpolicy.streams.backlog import PER_STREAM, PLACE, TOTAL, Backlog
from contextpolicy.streams.decoding import MAX_PAYLOAD


def test_the_order_of_arrival_holds_across_streams() -> None:
    backlog = Backlog[str](PER_STREAM, TOTAL)
    imu, mic = backlog.lane(), backlog.lane()
    for lane, item in ((mic, "a"), (imu, "b"), (imu, "c"), (mic, "d")):
        backlog.put(lane, item, 1)
    assert [backlog.take([imu, mic]) for _ in range(5)] == ["a", "b", "c", "d", None]


def test_take_returns_only_items_of_the_given_lanes() -> None:
    backlog = Backlog[str](PER_STREAM, TOTAL)
    ours, others = backlog.lane(), backlog.lane()
    backlog.put(others, "theirs", 1)
    assert backlog.take([ours]) is None
    assert len(others.waiting) == 1


def test_beyond_the_total_the_largest_stream_drops_its_oldest() -> None:
    backlog = Backlog[str](1_000_000, 5 * PLACE)
    quiet, loud = backlog.lane(), backlog.lane()
    backlog.put(quiet, "quiet", 0)
    for n in range(10):
        backlog.put(loud, f"loud {n}", 0)
    assert [backlog.take([quiet, loud]) for _ in range(6)] == ["quiet", "loud 6", "loud 7", "loud 8", "loud 9", None]
    assert (backlog.overrun(quiet), backlog.overrun(loud), backlog.overrun(loud)) == (0, 6, 0)


def test_the_total_is_never_exceeded() -> None:
    """The largest payloads on more streams than have room for one each, and all their bytes are free afterwards."""
    backlog = Backlog[bytes](PER_STREAM, TOTAL)
    lanes = [backlog.lane() for _ in range(40)]
    for _ in range(5):
        for lane in lanes:
            backlog.put(lane, b"", MAX_PAYLOAD)
            assert sum(one.weight for one in lanes) <= TOTAL
            assert lane.weight <= PER_STREAM
    assert lanes[-1].waiting, "the newest stays"
    while backlog.take(lanes) is not None:
        pass
    assert sum(one.weight for one in lanes) == 0


def test_a_closed_lane_frees_its_room_and_accepts_nothing() -> None:
    backlog = Backlog[str](1_000_000, 2 * PLACE)
    gone, stays = backlog.lane(), backlog.lane()
    backlog.put(gone, "x", 0)
    backlog.close(gone)
    backlog.put(gone, "late", 0)
    for item in ("a", "b"):
        backlog.put(stays, item, 0)
    assert [backlog.take([gone, stays]) for _ in range(3)] == ["a", "b", None]
