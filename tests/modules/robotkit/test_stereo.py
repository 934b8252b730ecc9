from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as some

from robotkit import MessageError
from robotkit.stereo import StereoFrame, decode, encode


@given(some.integers(0, 2**63 - 1), some.binary(max_size=50), some.binary(max_size=50))
def test_a_frame_survives_the_bus(stamp, left, right):
    frame = StereoFrame(stamp, left, right)
    assert decode(encode(frame)) == frame


@given(some.binary(max_size=40))
def test_noise_is_refused(noise):
    with pytest.raises(MessageError, match="not a stereo frame"):
        decode(noise)


@pytest.mark.parametrize("change", [lambda payload: payload[:-1], lambda payload: payload + b"x"])
def test_a_frame_of_the_wrong_length_is_refused(change):
    with pytest.raises(MessageError, match="its header says"):
        decode(change(encode(StereoFrame(1, b"left", b"right"))))
