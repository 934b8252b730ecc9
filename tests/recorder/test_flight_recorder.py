"""Bounded memory, whatever comes."""

from __future__ import annotations

import pytest

from contextpolicy.recorder.flight_recorder import OVERHEAD, FlightRecorder, PlanRecord, SampleRecord


def sample(at, stream="imu", size=0):
    return SampleRecord(at, stream, b"x" * size, b"", "")


@pytest.fixture
def recorder():
    return FlightRecorder(budget=40 * OVERHEAD, seconds=60.0)


@pytest.fixture
def records(recorder):
    return recorder.begin("lab/robot")


def test_it_keeps_the_newest_that_fit(recorder, records):
    for at in range(50):
        recorder.take_sample(records, sample(float(at)))
    assert [one.arrived for one in records.samples] == [float(at) for at in range(20, 50)]
    assert records.sample_bytes == 30 * OVERHEAD
    assert records.before["imu"].arrived == 19.0


def test_a_large_payload_takes_the_place_of_many(recorder, records):
    for at in range(10):
        recorder.take_sample(records, sample(float(at)))
    recorder.take_sample(records, sample(10.0, "scan", size=25 * OVERHEAD))
    assert records.sample_bytes <= 30 * OVERHEAD
    assert records.samples[-1].stream == "scan"
    assert len(records.samples) == 5


def test_one_that_is_larger_than_everything_is_not_kept(recorder, records):
    recorder.take_sample(records, sample(1.0))
    recorder.take_sample(records, sample(2.0, "scan", size=100 * OVERHEAD))
    assert [one.stream for one in records.samples] == ["imu"]
    assert records.before == {}


def test_what_is_older_than_the_window_goes(recorder, records):
    recorder.take_sample(records, sample(0.0))
    recorder.take_sample(records, sample(61.0))
    assert [one.arrived for one in records.samples] == [61.0]


def test_policies_share_what_there_is(recorder, records):
    recorder.begin("lab/other")
    for at in range(50):
        recorder.take_sample(records, sample(float(at)))
    assert len(records.samples) == 15


def test_samples_do_not_push_out_plans(recorder, records):
    recorder.take_plan(records, PlanRecord(0.0, b"{}"))
    for at in range(50):
        recorder.take_sample(records, sample(float(at)))
    assert len(records.plans) == 1


def test_the_plan_in_force_is_kept_however_old_or_large(recorder, records):
    recorder.take_plan(records, PlanRecord(0.0, b"x" * 100 * OVERHEAD))
    recorder.take_plan(records, PlanRecord(900.0, b"y" * 100 * OVERHEAD))
    assert [one.published for one in records.plans] == [900.0]


def test_plans_since_a_moment(recorder, records):
    for at in (1.0, 2.0, 3.0):
        recorder.take_plan(records, PlanRecord(at, b"{}"))
    assert [one.published for one in recorder.plans_since("lab/robot", 1.0)] == [2.0, 3.0]
    assert list(recorder.plans_since("lab/nobody", 0.0)) == []


def test_an_edit_goes_on_with_the_same_records(recorder, records):
    assert recorder.begin("lab/robot") is records
    recorder.forget("lab/robot")
    assert recorder.of("lab/robot") is None
