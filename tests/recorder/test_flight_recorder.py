"""The flight recorder's memory stays bounded."""

from __future__ import annotations

import pytest

from contextpolicy.recorder.flight_recorder import OVERHEAD, FlightRecorder, PlanRecord, SampleRecord


def sample(at, stream="imu", size=0):
    return SampleRecord(at, stream, b"x" * size, b"", "")


@pytest.fixture
def recorder():
    return FlightRecorder(40 * OVERHEAD, 60.0)


@pytest.fixture
def records(recorder):
    return recorder.begin("lab/robot", ["imu", "scan"])


def test_it_keeps_the_newest_that_fit(recorder, records):
    for at in range(50):
        recorder.take_sample(records, sample(float(at)))
    assert [one.arrived for one in records.samples] == [float(at) for at in range(21, 50)]
    assert records.sample_bytes == 29 * OVERHEAD
    assert records.before["imu"].arrived == 20.0


def test_a_large_payload_takes_the_place_of_many(recorder, records):
    for at in range(10):
        recorder.take_sample(records, sample(float(at)))
    recorder.take_sample(records, sample(10.0, "scan", size=25 * OVERHEAD))
    assert records.sample_bytes <= 30 * OVERHEAD
    assert records.samples[-1].stream == "scan"
    assert len(records.samples) == 4


def test_a_sample_larger_than_the_memory_is_dropped(recorder, records):
    recorder.take_sample(records, sample(1.0))
    recorder.take_sample(records, sample(2.0, "scan", size=100 * OVERHEAD))
    assert [one.stream for one in records.samples] == ["imu"]
    assert records.before == {}


def test_samples_older_than_the_window_are_dropped(recorder, records):
    recorder.take_sample(records, sample(0.0))
    recorder.take_sample(records, sample(61.0))
    assert [one.arrived for one in records.samples] == [61.0]


def test_samples_of_a_removed_stream_expire(recorder, records):
    for at in range(40):
        recorder.take_sample(records, sample(float(at), "scan" if at < 20 else "imu"))
    assert records.before["scan"].arrived == 10.0
    recorder.begin("lab/robot", ["imu"])
    assert records.before == {}
    for at in range(40, 80):
        recorder.take_sample(records, sample(float(at)))
    assert records.before.keys() == {"imu"}


def test_policies_share_the_memory(recorder, records):
    recorder.begin("lab/other", ["imu"])
    for at in range(50):
        recorder.take_sample(records, sample(float(at)))
    assert len(records.samples) == 14


def all_bytes(recorder, *policies):
    """What the samples of these policies take."""
    found = [recorder.of(policy) for policy in policies]
    return sum(
        OVERHEAD + len(one[2]) + len(one[3]) + len(one[4])
        for records in found
        for one in (*records.samples, *records.before.values())
    )


def test_last_samples_of_many_streams_stay_within_the_memory(recorder):
    """64 streams of one key kept a payload each beside the memory that all policies share."""
    streams, policies = [f"s{number}" for number in range(64)], ("lab/robot", "lab/other")
    for policy in policies:
        records = recorder.begin(policy, streams)
        for at in range(3):
            for stream in streams:
                recorder.take_sample(records, sample(float(at), stream, size=3 * OVERHEAD))
    assert all_bytes(recorder, *policies) <= 30 * OVERHEAD
    assert all(recorder.of(policy).samples for policy in policies)


def test_a_new_policy_takes_its_part_of_the_memory_at_once(recorder, records):
    for number in range(40):
        recorder.take_sample(records, sample(float(number), "imu" if number % 2 else "scan"))
    for policy in ("lab/second", "lab/third"):
        for number in range(40):
            recorder.take_sample(recorder.begin(policy, ["imu"]), sample(float(number)))
    assert all_bytes(recorder, "lab/robot", "lab/second", "lab/third") <= 30 * OVERHEAD


def test_a_large_payload_stays_in_place_of_what_was_before(recorder, records):
    for at in range(40):
        recorder.take_sample(records, sample(float(at), "imu" if at % 2 else "scan"))
    recorder.take_sample(records, sample(40.0, "scan", size=29 * OVERHEAD))
    assert [one.arrived for one in records.samples] == [40.0]
    assert records.before == {}


def test_samples_do_not_evict_plans(recorder, records):
    recorder.take_plan("lab/robot", PlanRecord(0.0, b"{}"))
    for at in range(50):
        recorder.take_sample(records, sample(float(at)))
    assert len(records.plans) == 1


def test_the_plan_in_force_is_kept_however_old_or_large(recorder, records):
    recorder.take_plan("lab/robot", PlanRecord(0.0, b"x" * 100 * OVERHEAD))
    recorder.take_plan("lab/robot", PlanRecord(900.0, b"y" * 100 * OVERHEAD))
    assert [one.published for one in records.plans] == [900.0]


@pytest.mark.usefixtures("records")
def test_plans_since_a_moment(recorder):
    for at in (1.0, 2.0, 3.0):
        recorder.take_plan("lab/robot", PlanRecord(at, b"{}"))
    assert [one.published for one in recorder.plans_since("lab/robot", 1.0)] == [2.0, 3.0]
    assert list(recorder.plans_since("lab/nobody", 0.0)) == []


@pytest.mark.usefixtures("records")
def test_a_plan_ends_once(recorder):
    for at in (1.0, 2.0):
        recorder.take_plan("lab/robot", PlanRecord(at, b"{}"))
    for at in (3.0, 4.0):
        recorder.end_plan("lab/robot", at)
    assert [one.until for one in recorder.plans_since("lab/robot", 0.0)] == [None, 3.0]
    recorder.end_plan("lab/nobody", 3.0)
    recorder.begin("lab/other", [])
    recorder.end_plan("lab/other", 3.0)
    assert list(recorder.plans_since("lab/other", 0.0)) == []


def test_an_edit_continues_with_the_same_records(recorder, records):
    assert recorder.begin("lab/robot", ["imu", "scan"]) is records
    recorder.forget("lab/robot")
    assert recorder.of("lab/robot") is None


@pytest.mark.parametrize("field", ["attachment", "key"])
def test_key_and_attachment_count_towards_the_size(recorder, records, field):
    large = b"x" * 9 * OVERHEAD if field == "attachment" else "x" * 9 * OVERHEAD
    for at in range(10):
        recorder.take_sample(records, sample(float(at))._replace(**{field: large}))
    assert len(records.samples) == 3
    assert records.sample_bytes == 30 * OVERHEAD
    recorder.take_sample(records, sample(70.0))
    assert records.sample_bytes == OVERHEAD, "what goes is taken off as it was added"
