"""Frames between processes that have one /dev/shm, and between those that have not."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from robotkit import Input
from robotkit.inputs import Inputs
from tests.modules.robotkit.bus import Matching, client, router, soon

FRAME = bytes(range(256)) * 1000


@pytest.mark.parametrize("both", [True, False])
def test_a_frame_stays_where_it_is_when_all_share_memory(both):
    with ExitStack() as stack:
        address = stack.enter_context(router())
        camera = stack.enter_context(client(address, shared_memory=True))
        module = stack.enter_context(client(address, shared_memory=both))
        publisher = camera.declare_publisher("test/frame")
        matching = Matching(publisher)
        inputs = Inputs(module, {"frame": Input("test/frame", depth=5)})
        inputs.resume()
        matching.wait(expected=True)
        for _ in range(3):  # the memory is made when the first frame asks for it, which itself goes by TCP
            publisher.put(FRAME)
            assert soon(inputs.take).payload == FRAME
        assert (inputs.shared["frame"] > 0) == both
        inputs.close()


def test_small_messages_are_sent():
    with router() as address, client(address, shared_memory=True) as one, client(address, shared_memory=True) as other:
        publisher = one.declare_publisher("test/small")
        matching = Matching(publisher)
        inputs = Inputs(other, {"small": Input("test/small")})
        inputs.resume()
        matching.wait(expected=True)
        publisher.put(b"7")
        assert soon(inputs.take).payload == b"7"
        assert inputs.shared["small"] == 0
        inputs.close()
