"""Frames between processes that have one /dev/shm, and between those that have not."""

from __future__ import annotations

import subprocess
import sys
from contextlib import ExitStack

import pytest

from robotkit import Input
from robotkit.inputs import Inputs
from tests.modules.robotkit.bus import Matching, client, router, soon
from tests.waiting import until

FRAME = bytes(range(256)) * 1000
USUAL = 8 << 20
"""What systemd lets a service and its children lock, a container's processes too: they don't have CAP_IPC_LOCK."""
CAMERA = """
import sys
from tests.modules.robotkit.bus import Matching, client
from tests.modules.robotkit.test_shared_memory import FRAME
with client(sys.argv[1], shared_memory=True) as camera:
    publisher = camera.declare_publisher("test/frame")
    Matching(publisher).wait(expected=True)
    for _ in sys.stdin:
        publisher.put(FRAME)
"""


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

        def shared():
            publisher.put(FRAME)
            assert soon(inputs.take).payload == FRAME
            return inputs.shared["frame"]

        if both:
            until(shared)  # the memory is made when the first frame asks for it, which itself goes by TCP
        else:
            assert [shared() for _ in range(3)] == [0, 0, 0]
        inputs.close()


def test_a_containers_process_may_lock_enough_memory():
    argv = ["setpriv", "--bounding-set", "-ipc_lock", "prlimit", f"--memlock={USUAL}", sys.executable, "-c", CAMERA]
    with router() as address, client(address, shared_memory=True) as module:
        inputs = Inputs(module, {"frame": Input("test/frame", depth=5)})
        inputs.resume()
        with subprocess.Popen([*argv, address], stdin=subprocess.PIPE, text=True) as camera:
            stdin = camera.stdin
            assert stdin is not None

            def shared():
                stdin.write("\n")
                stdin.flush()
                assert soon(inputs.take).payload == FRAME
                return inputs.shared["frame"]

            until(shared)
            stdin.close()
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
