"""Policies that are deleted without our finalizer, and new ones with the same name, in virtual time."""

from __future__ import annotations

import pytest

from tests.planning.builders import a_task
from tests.policies.builders import IMU, a_policy


def replaced(version="9", **spec):
    """Another policy of the same name."""
    body = a_policy(**spec)
    return {**body, "metadata": {**body["metadata"], "uid": "uid-another", "resourceVersion": version}}


def replace_unseen(operator, body):
    """Somebody took its finalizer away while nobody watched."""
    operator.cluster.policies["lab/robot"] = {}
    operator.cluster.statuses.clear()
    operator.cluster.change_originals("lab/robot", {})
    operator.see()
    operator.apply(body)
    operator.settle()


def test_a_policy_that_replaces_another_unseen_takes_up_none_of_its_state(running):
    running.react(IMU, speed=0.3)
    replace_unseen(running, replaced())
    assert running.limits() == {"slam": 500, "speech": 500}, "this one has not heard that the robot moves"
    assert None in running.session.plans(), "agents must not act on the plan of one that is gone"
    assert running.condition("Accepted")[0] == "True"
    running.react(IMU, speed=0.3)
    assert running.limits() == {"slam": 800, "speech": 200}
    assert running.cluster.policies["lab/robot"].keys() == {"uid-slam", "uid-speech"}


def test_an_invalid_policy_that_replaces_another_unseen_does_not_keep_it_in_force(running):
    running.react(IMU, speed=0.3)
    replace_unseen(running, replaced(tasks=[a_task("slam", min="2", max="1")]))
    assert running.limits() == {"slam": 400, "speech": 400}
    assert running.condition("Accepted")[:2] == ("False", "Invalid")


def test_a_policy_that_is_gone_without_a_release_is_restored(running):
    """Somebody took its finalizer away and deleted it."""
    running.react(IMU, speed=0.3)
    del running.cluster.policies["lab/robot"]
    running.operator.policy_gone("uid-robot")
    running.settle()
    assert running.limits() == {"slam": 400, "speech": 400}
    assert running.session.plans()[-1] is None
    assert running.operator.queries._registry.find("lab/robot") is None


def test_the_end_of_a_former_policy_leaves_the_next_of_its_name_alone(running):
    running.react(IMU, speed=0.3)
    replace_unseen(running, replaced())
    running.react(IMU, speed=0.3)
    running.operator.policy_gone("uid-robot")
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def late():
    """The former policy, as kopf may still show it: each object has a queue of its own."""
    body = a_policy()
    return {**body, "metadata": {**body["metadata"], "resourceVersion": "8"}}


def test_a_former_policy_that_comes_late_does_not_end_the_next_of_its_name(running):
    replace_unseen(running, replaced())
    running.react(IMU, speed=0.3)
    assert running.apply(late()).result(timeout=0) is False, "kopf shows it again unless it is gone"
    running.settle()
    running.operator.policy_gone("uid-robot")
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_a_late_release_of_a_former_policy_restores_nothing(running):
    replace_unseen(running, replaced())
    running.react(IMU, speed=0.3)
    assert running.delete(late()).done()
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


@pytest.mark.parametrize("version", ["7", "9"], ids=["of a backup", "newer"])
def test_another_policy_of_a_name_is_taken_up_at_the_latest_when_the_former_is_gone(running, version):
    """The versions of a cluster that was restored from a backup are older."""
    running.apply(late())
    replace_unseen(running, replaced(version))
    running.operator.policy_gone("uid-robot")
    running.settle()
    running.apply(replaced(version))
    running.react(IMU, speed=0.3)
    assert running.operator.queries._registry.find("lab/robot").body["metadata"]["uid"] == "uid-another"
    assert running.limits() == {"slam": 800, "speech": 200}


@pytest.mark.parametrize(
    "stop",
    [lambda robot: robot.delete(a_policy()), lambda robot: robot.apply(a_policy(mode="Paused"))],
    ids=["deleted", "paused"],
)
def test_putting_back_is_no_foreign_resize_to_a_policy_that_comes_meanwhile(running, stop):
    """The watch does not show yet what the operator itself has put back."""
    stop(running)
    running.apply(a_policy(generation=3))
    running.settle()
    assert running.limits() == {"slam": 500, "speech": 500}
    assert "ResizedByOther" not in dict(running.reported())
