"""An operator that starts beside an agent, or after one that is gone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.actuators.resize.takeover import REWRITE_AFTER
from tests.actuators.resize.rig import Rig
from tests.actuators.resize.taking_over import HERE, NOWHERE, OVER, an_order, asked, in_force
from tests.cluster.builders import a_pod


@pytest.mark.parametrize("died_before", [0.0, 5.0, 14.9])
def test_an_operator_without_the_agent_rewrites_what_the_agent_wrote(died_before):
    """Agent and operator end within seconds: the supervisor undoes what the API has, and nobody remembers."""
    rig = in_force(slam=300)
    if died_before:
        rig.apply(an_order(NOWHERE, slam=300))
        rig.wait(died_before)
    rig.kill()
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(REWRITE_AFTER - 0.1)
    assert asked(rig) == []
    rig.wait(0.2)
    rig.settle()
    assert asked(rig) == [("slam", "99m", "300m"), ("slam", "100m", "300m")]


def test_operator_restart_beside_a_live_agent_rewrites_nothing():
    rig = in_force(slam=300)
    rig.kill()
    rig.apply(an_order(HERE, slam=300))
    rig.wait(600)
    rig.settle()
    assert asked(rig) == []


def test_an_empty_first_order_still_remembers_the_agent():
    rig = in_force(slam=300)
    rig.kill()
    rig.apply(an_order(NOWHERE))
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.settle()
    assert asked(rig)[-1] == ("slam", "100m", "300m")


def test_operator_restart_rewrites_nothing_without_an_agent():
    rig = Rig(a_pod("slam"))
    rig.apply(an_order(NOWHERE, slam=300))
    rig.settle()
    rig.cluster.calls.clear()
    rig.kill()
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(600)
    rig.settle()
    assert asked(rig) == []


def test_agent_that_joined_after_the_first_resize_is_remembered():
    rig = Rig(a_pod("slam"))
    rig.apply(an_order(NOWHERE, slam=300))
    rig.settle()
    rig.apply(an_order(HERE, slam=300))
    rig.settle()
    rig.cluster.calls.clear()
    rig.kill()
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.settle()
    assert len(asked(rig)) == 2


def test_killing_a_frozen_agent_after_takeover_triggers_a_second_rewrite():
    """Its supervisor undoes then what it wrote before it froze, over what the operator has put in its place."""
    rig = in_force(slam=300)
    rig.apply(an_order(NOWHERE, attended=HERE, slam=300))
    rig.wait(OVER)
    rig.settle()
    assert len(asked(rig)) == 2
    rig.apply(an_order(NOWHERE, attended=NOWHERE, slam=300))
    rig.wait(OVER)
    rig.settle()
    assert len(asked(rig)) == 4
    assert rig.cluster.limit("slam") == 300


@pytest.mark.parametrize("attended", [HERE, NOWHERE], ids=["frozen", "killed"])
def test_the_next_operator_rewrites_what_an_agent_wrote_ahead_of_the_api(attended):
    """The plan had not lasted yet: its first resize, and so its original, came only after the agent had ended."""
    rig = Rig(a_pod("slam"))
    rig.apply(an_order(HERE, slam=500, limits={"slam": None}))
    rig.settle()
    rig.apply(an_order(NOWHERE, attended=attended, slam=300))
    rig.work()
    assert rig.cluster.limit("slam") == 300
    rig.wait(5)
    rig.cluster.confirm()
    rig.watch()
    rig.kill()
    rig.cluster.calls.clear()
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.settle()
    assert asked(rig) == [("slam", "99m", "300m"), ("slam", "100m", "300m")]


def test_partial_first_order_still_rewrites_all_claimed_containers():
    rig = in_force(slam=300, speech=200)
    rig.kill()
    both = an_order(NOWHERE, slam=300, speech=200)
    rig.apply(replace(an_order(NOWHERE, speech=200), claimed=both.claimed))
    rig.wait(1)
    rig.apply(both)
    rig.wait(OVER)
    rig.settle()
    assert sorted(asked(rig))[2:] == [("speech", "100m", "200m"), ("speech", "99m", "200m")]
    assert sorted(asked(rig))[:2] == [("slam", "100m", "300m"), ("slam", "99m", "300m")]
