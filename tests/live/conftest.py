"""An operator in virtual time whose recorder's clock is virtual too."""

from __future__ import annotations

import pytest

from tests.cluster.builders import a_pod
from tests.policies.builders import IMU, a_policy, resources
from tests.virtual_operator import VirtualOperator


@pytest.fixture
def operator(monkeypatch):
    """A robot that stood for 10 s, moved for 10 s, and stands again for 5 s."""
    started = VirtualOperator(*(a_pod(name, {name: resources()}) for name in ("slam", "speech")))
    started.keep_time(monkeypatch)
    started.list_all()
    started.connect()
    started.apply(a_policy())
    for speed, lasts in ((0.0, 10.0), (0.3, 10.0), (0.0, 5.0)):
        started.sample(IMU, speed=speed)
        started.settle()
        started.turn(lasts)
    started.loop.inline = True
    return started
