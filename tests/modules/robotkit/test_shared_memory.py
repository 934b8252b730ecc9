"""Frames between processes that have one /dev/shm, and between those that have not."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager

import pytest

from robotkit import Input, Result
from robotkit.inputs import Inputs
from robotkit.module import Output
from robotkit.outputs import Outputs
from robotkit.session import POOL
from robotkit.stamps import attachment
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
def test_frames_use_shared_memory_only_if_both_peers_do(both):
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


@pytest.mark.parametrize("both", [True, False])
def test_a_frame_with_a_wrong_checksum_is_dropped(both):
    with (
        router() as address,
        client(address, shared_memory=True) as camera,
        client(address, shared_memory=both) as module,
    ):
        inputs = Inputs(module, {"frame": Input("test/frame", depth=5)})
        inputs.resume()
        publisher = camera.declare_publisher("test/frame")
        Matching(publisher).wait(expected=True)

        def shared():
            publisher.put(FRAME, attachment=attachment(1, FRAME))
            assert soon(inputs.take).payload == FRAME
            return inputs.shared["frame"]

        until(lambda: shared() or not both)
        torn = FRAME[:-1] + b"?"
        publisher.put(torn, attachment=attachment(2, FRAME))
        publisher.put(FRAME, attachment=attachment(3, FRAME))
        received = soon(inputs.take)
        assert (received.payload, received.stamp, inputs.dropped) == (FRAME, 3, {"frame": 1})
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


# a peer that gets no CPU: stopped in the middle of whatever it does, as one that its quota throttles

RESTLESS_CAMERA = """
import sys
from tests.modules.robotkit.bus import client
from tests.modules.robotkit.test_shared_memory import FRAME
with client(sys.argv[1], shared_memory=True) as camera:
    publisher = camera.declare_publisher("test/other")
    print("ready", flush=True)
    while True:
        publisher.put(FRAME)
"""
HOARDER = """
import sys
from robotkit import Input
from robotkit.inputs import Inputs
from tests.modules.robotkit.bus import client
with client(sys.argv[1], shared_memory=True) as module:
    inputs = Inputs(module, {"frame": Input("test/frame/*", depth=200)})
    inputs.resume()
    print("ready", flush=True)
    sys.stdin.read()
    while True:
        one = inputs.take()
        line = " ".join([one.key.rpartition("/")[2], *map(str, set(one.payload))])
        print(line + "\\n", end="", flush=True)  # at once: it is killed in between
"""
ALL_OF_IT = POOL // len(FRAME) + 1
"""Frames of which not all fit into a publisher's shared memory."""


@contextmanager
def a_peer(program, address):
    argv = [sys.executable, "-c", program, address]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:
        assert peer.stdout is not None
        assert peer.stdout.readline() == "ready\n"
        try:
            yield peer
        finally:
            peer.kill()


@contextmanager
def camera_and_module(address):
    """Call the result to send a frame of one value and wait for it; it returns how many came by shared memory."""
    with client(address, shared_memory=True) as camera, client(address, shared_memory=True) as module:
        inputs = Inputs(module, {"frame": Input("test/frame/*", depth=5), "other": Input("test/other")})
        inputs.resume()
        publisher = camera.declare_publisher("test/frame/1")  # undeclared with its last reference
        Matching(publisher).wait(expected=True)
        names = ("1", "2")
        outputs = Outputs(camera, {name: Output(f"test/frame/{name}", "raw") for name in names}, shared_memory=True)

        def send(number):
            frame = bytes([number]) * len(FRAME)
            outputs.publish(Result(str(number), frame))
            while soon(inputs.take).payload != frame:
                pass  # one of the peer's
            return inputs.shared["frame"]

        yield send
        inputs.close()


@pytest.mark.parametrize("program", [RESTLESS_CAMERA, HOARDER], ids=["writer", "reader"])
def test_a_stopped_peer_blocks_neither_readers_nor_writers(program):
    with router() as address, camera_and_module(address) as send, a_peer(program, address) as peer:
        until(lambda: send(1))
        peer.send_signal(signal.SIGSTOP)
        before = send(1)
        until(lambda: send(1) >= before + ALL_OF_IT)  # what the stopped one held is free again


def test_an_overwritten_frame_is_dropped():
    with router() as address, camera_and_module(address) as send, a_peer(HOARDER, address) as peer:
        until(lambda: send(1) >= ALL_OF_IT // 2)
        peer.send_signal(signal.SIGSTOP)
        before = send(1)
        until(lambda: send(2) >= before + 3 * ALL_OF_IT)
        peer.send_signal(signal.SIGCONT)
        frames: list[list[str]] = []
        stdin, stdout = peer.stdin, peer.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.close()
        reader = threading.Thread(target=lambda: frames.extend(line.split() for line in stdout))
        reader.start()
        until(lambda: send(2) and ["2", "2"] in frames)  # it may have to connect again first
        peer.kill()
        reader.join()
    assert [content for name, *content in frames if content != [name]] == []
