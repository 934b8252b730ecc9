"""What streams keep of their last samples stays bounded, and nobody's samples are refused because of a neighbour's."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from contextpolicy.policy.stream_spec import Stream
from contextpolicy.streams.decoding import MAX_PAYLOAD, Decoder
from contextpolicy.streams.retention import LEAST, POOL, Retention, footprint

STREAMS = [Stream(f"s{number}", "robot/text") for number in range(64)]
NAMES = [stream.name for stream in STREAMS]


def filled(retention, policy, namespace="lab", size=MAX_PAYLOAD):
    """How many streams of a policy may keep a payload of this size."""
    kept = retention.begin(policy, namespace, NAMES)
    return sum(retention.admit(kept, stream, size) for stream in STREAMS)


def test_last_samples_of_all_policies_stay_within_the_memory():
    retention = Retention(POOL)
    assert 0 < filled(retention, "lab/first") * footprint(STREAMS[0], MAX_PAYLOAD) <= POOL
    assert filled(retention, "lab/second") == 0


def test_usual_samples_are_never_refused():
    """Twenty robots of ten streams: JSON of half a kilobyte."""
    retention = Retention(POOL)
    for robot in range(20):
        kept = retention.begin(f"robot-{robot}/robot", f"robot-{robot}", NAMES)
        assert all(retention.admit(kept, stream, 500) for stream in STREAMS[:10])


@pytest.mark.parametrize("greedy", [1, 20])
def test_neighbours_leave_a_namespace_its_part(greedy):
    """However many policies they have."""
    retention = Retention(POOL)
    for number in range(greedy):
        filled(retention, f"elsewhere/p{number}", "elsewhere")
    kept = retention.begin("lab/robot", "lab", NAMES)
    assert retention.admit(kept, STREAMS[0], MAX_PAYLOAD)
    assert all(retention.admit(kept, stream, 5000) for stream in STREAMS)


def test_an_edit_forgets_only_streams_that_are_gone():
    retention = Retention(POOL)
    most = filled(retention, "lab/robot")
    assert filled(retention, "lab/robot") == most, "what is kept may be replaced"
    retention.begin("lab/robot", "lab", NAMES[1:])
    assert filled(retention, "lab/other") == 1
    retention.forget("lab/robot")
    retention.forget("lab/other")
    assert filled(retention, "lab/robot") == most


@pytest.mark.parametrize("change", [{"sources": 4}, {"debounce": 1.0}, {"sample_every": 1.0}])
def test_a_stream_that_keeps_more_after_an_edit_is_charged_for_it(change):
    plain, edited = STREAMS[0], replace(STREAMS[0], **change)
    retention = Retention(footprint(edited, 16384))
    assert retention.admit(retention.begin("lab/robot", "lab", NAMES), plain, 16384)
    kept = retention.begin("lab/robot", "lab", NAMES)
    assert retention.admit(kept, edited, 100), "what it kept before is replaced by and by"
    assert not retention.admit(kept, STREAMS[1], 1)
    assert retention.admit(retention.begin("lab/robot", "lab", NAMES), plain, 16384)
    assert retention.admit(kept, STREAMS[1], 1)


def test_a_stream_that_would_keep_too_much_after_an_edit_is_refused():
    edited = replace(STREAMS[0], sources=4)
    retention = Retention(footprint(edited, 16384) - 1)
    assert retention.admit(retention.begin("lab/robot", "lab", NAMES), STREAMS[0], 16384)
    kept = retention.begin("lab/robot", "lab", NAMES)
    assert not retention.admit(kept, edited, 1)
    assert retention.admit(kept, STREAMS[0], 16384), "a refused sample changes nothing"


def test_an_edit_that_keeps_no_more_is_refused_nothing():
    """Even if a namespace that came meanwhile has made the equal part smaller."""
    retention = Retention(footprint(STREAMS[0], 16384))
    assert retention.admit(retention.begin("lab/robot", "lab", NAMES), STREAMS[0], 16384)
    assert retention.admit(retention.begin("shop/robot", "shop", NAMES), STREAMS[0], 1)
    assert retention.admit(retention.begin("lab/robot", "lab", NAMES), replace(STREAMS[0]), 16384)


def test_readings_of_varying_length_are_charged_once():
    retention = Retention(footprint(STREAMS[0], LEAST))
    kept = retention.begin("lab/robot", "lab", NAMES)
    assert [retention.admit(kept, STREAMS[0], size) for size in (0, 1, LEAST - 1, LEAST)] == [True] * 4
    assert not retention.admit(kept, STREAMS[0], LEAST + 1)
    assert not retention.admit(kept, STREAMS[1], 1)
    assert retention.admit(kept, STREAMS[0], LEAST), "a refused sample changes nothing"


def test_what_is_held_back_is_kept_besides():
    plain, slow = STREAMS[0], replace(STREAMS[0], debounce=1.0)
    assert footprint(slow, MAX_PAYLOAD) - footprint(plain, MAX_PAYLOAD) == 4 * MAX_PAYLOAD
    assert footprint(replace(plain, sample_every=1.0), 100) == footprint(slow, 100)


def test_all_sources_keep_no_more_than_a_stream_without_sources():
    many = replace(STREAMS[0], sources=50)
    assert footprint(many, 1000) == footprint(STREAMS[0], 50_000)
    assert footprint(many, MAX_PAYLOAD) == footprint(STREAMS[0], MAX_PAYLOAD)


def test_decoded_text_takes_no_more_than_its_charge():
    """One rare letter makes Python keep four bytes for each."""
    text = ("x" * 60_000 + "\U0001f916").encode()
    sample = Decoder(STREAMS[0]).decode(b'"' + text + b'"')
    assert sys.getsizeof(sample.value["value"]) > 4 * 60_000
    assert sys.getsizeof(sample.value["value"]) <= footprint(STREAMS[0], len(text) + 2)
