"""What is attached to a result."""

from __future__ import annotations

import json
import zlib
from unittest.mock import Mock

import pytest

from robotkit import Result
from robotkit.module import Output
from robotkit.outputs import Outputs
from robotkit.session import SHARED_FROM
from tests.modules.robotkit.bus import ask, client, router


@pytest.mark.parametrize(
    ("shared_memory", "size", "expected"),
    [(True, SHARED_FROM, True), (True, SHARED_FROM - 1, False), (False, SHARED_FROM, False)],
)
def test_shared_memory_payloads_carry_a_checksum(shared_memory, size, expected):
    session, payload = Mock(), b"7" * size
    outputs = Outputs(session, {"frame": Output("test/frame", "raw")}, shared_memory=shared_memory)
    outputs.publish(Result("frame", payload))
    put = session.declare_publisher.return_value.put
    said = json.loads(put.call_args.kwargs["attachment"])
    assert put.call_args.args == (payload,)
    assert said.get("crc32") == (zlib.crc32(payload) if expected else None)


def test_who_asks_gets_the_newest_result_unless_it_is_a_ros_message():
    outputs = {"word": Output("test/word"), "pose": Output("test/pose", "cdr", "geometry_msgs/msg/PointStamped", "map")}
    with router() as address, client(address) as module, client(address) as other:
        published = Outputs(module, outputs, shared_memory=False)
        published.publish(Result("word", {"said": "no"}, 1))
        published.publish(Result("word", {"said": "yes"}, 2))
        published.publish(Result("pose", {"point": [0, 0, 0]}))
        assert [json.loads(one) for one in ask(other, "test/*")] == [{"stamp": 2, "said": "yes"}]
