"""The node stops and starts, as a robot that is switched off and on. Runs outside of the node's network."""

import pytest

from tests.e2e.cluster import until
from tests.e2e.rebooted import ORIGINAL, PLANNED, ROBOT, governed, kubectl, limits
from tests.node import access, lifecycle

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="stops the node: not on yours")


def test_after_a_reboot_the_policy_holds_and_can_still_be_undone():
    with governed():
        lifecycle.down(keep_state=True)
        lifecycle.up()
        until("the policy holds after the reboot", lambda: limits() == PLANNED or limits(), patience=120)
        kubectl("delete", "ctxp", "robot", "-n", ROBOT, "--timeout=90s")
        until("every container is as it was", lambda: limits() == ORIGINAL or limits(), patience=60)
