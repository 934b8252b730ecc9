"""An operator in virtual time, before and after it governs a robot."""

from __future__ import annotations

import pytest

from tests.cluster.builders import a_pod
from tests.policies.builders import IMU, a_policy, resources
from tests.virtual_operator import VirtualOperator


@pytest.fixture
def operator():
    return VirtualOperator(*(a_pod(name, {name: resources()}) for name in ("slam", "speech")))


@pytest.fixture
def running(operator):
    """A robot that stands still, governed."""
    operator.govern(a_policy())
    operator.react(IMU, speed=0.0)
    return operator
