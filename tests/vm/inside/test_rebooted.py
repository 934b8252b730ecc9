"""The machine was rebooted: everything comes back by itself, under the policy, and can still be undone."""

from tests.e2e.cluster import until
from tests.vm.chart import ROBOT
from tests.vm.inside.conftest import all_ready
from tests.vm.inside.robot import TASKS, agreed, let_go, ready


def test_limits_hold_after_a_reboot_and_can_be_restored():
    until("operator, router and agent are ready", all_ready, patience=1200)
    for name in TASKS:
        until(f"pod {name} is ready", lambda name=name: ready(name, ROBOT))
    agreed(slam=300, speech=100)
    let_go()
    agreed(slam=500, speech=500)
