"""Callbacks on Zenoh's own threads, between real sessions."""

from __future__ import annotations

import threading

import zenoh

from contextpolicy.streams.direct import directly
from tests.modules.robotkit.bus import Matching, client, router
from tests.waiting import until

KEY, MESSAGES = "direct/count", 50


class Seen(threading.local):
    """What Python keeps with its state of a thread."""

    before = False


def test_python_keeps_its_state_of_a_zenoh_thread_from_one_callback_to_the_next():
    seen, new = Seen(), []

    def on_sample(_):
        new.append(None if seen.before else threading.get_ident())
        seen.before = True

    with router() as address, client(address) as operator, client(address) as robot:
        operator.declare_subscriber(KEY, directly(on_sample))
        publisher = robot.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.BLOCK)
        Matching(publisher).wait(expected=True)
        for _ in range(MESSAGES):
            publisher.put(b"1")
        until(lambda: len(new) == MESSAGES)

    threads = [thread for thread in new if thread is not None]
    assert 0 < len(threads) == len(set(threads)) < MESSAGES
