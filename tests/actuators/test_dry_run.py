from __future__ import annotations

import pytest

from contextpolicy.actuators.dry_run import DryRun
from contextpolicy.actuators.order import Order


@pytest.fixture
def reported(caplog):
    caplog.set_level("INFO")
    return caplog


def order(policy="lab/robot", **shares):
    return Order(policy, frozenset(shares), shares)


def test_dry_run_logs_what_it_would_do(reported):
    DryRun().apply(order(slam=1500, speech=2000))
    assert reported.messages == [
        "dry run: lab/robot would give slam a share of 1500m and a limit of 1500m",
        "dry run: lab/robot would give speech a share of 2 and a limit of 2",
    ]


def test_dry_run_logs_only_changes(reported):
    dry_run = DryRun()
    dry_run.apply(order(slam=500, speech=500))
    reported.clear()
    dry_run.apply(order(slam=500, speech=500))
    dry_run.apply(order(slam=500, speech=300))
    assert reported.messages == ["dry run: lab/robot would give speech a share of 300m and a limit of 300m"]


def test_policies_are_distinguished(reported):
    dry_run = DryRun()
    dry_run.apply(order(slam=500))
    dry_run.apply(order("lab/other", slam=500))
    assert len(reported.messages) == 2


def test_dry_run_logs_an_uncapped_task(reported):
    DryRun().apply(Order("lab/robot", frozenset(["slam"]), {"slam": 1500}, limits={"slam": None}))
    assert reported.messages == ["dry run: lab/robot would give slam a share of 1500m and its original limit"]


@pytest.mark.parametrize("leave", [DryRun.abandon, lambda dry_run, policy: dry_run.release(policy, lambda: None)])
def test_policy_that_returns_is_logged_again(reported, leave):
    dry_run = DryRun()
    for _ in range(2):
        dry_run.apply(order(slam=500))
        leave(dry_run, "lab/robot")
    assert len(reported.messages) == 2


def test_container_that_returns_is_logged_again(reported):
    dry_run = DryRun()
    for shares in ({"slam": 500}, {}, {"slam": 500}):
        dry_run.apply(order(**shares))
    assert len(reported.messages) == 2
