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
