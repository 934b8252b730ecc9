"""The node stops and starts, as a robot that is switched off and on. Runs outside of the node's network."""

import pytest

from tests.e2e.cluster import until
from tests.e2e.rebooted import ORIGINAL, PLANNED, ROBOT, governed, kubectl, limits
from tests.node import access, lifecycle
from tests.node.layout import ROOT

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="stops the node: not on yours")
AGENT = {
    "agent.enabled": "true",
    "agent.settleSeconds": "2",
    "agent.podLogs": str(ROOT / "pods"),
    "security.enabled": "true",
}
"""It wants signed plans, so a closed bus."""


@pytest.mark.parametrize("values", [{}, AGENT], ids=["resize", "agent"])
def test_after_a_reboot_the_policy_holds_and_can_still_be_undone(values):
    with governed(**values):
        lifecycle.down(keep_state=True)
        lifecycle.up()
        until("the policy holds after the reboot", lambda: limits() == PLANNED or limits(), patience=120)
        kubectl("delete", "ctxp", "robot", "-n", ROBOT, "--timeout=90s")
        until("every container is as it was", lambda: limits() == ORIGINAL or limits(), patience=60)
