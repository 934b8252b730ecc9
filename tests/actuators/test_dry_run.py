from __future__ import annotations

import pytest

from contextpolicy.actuators.dry_run import DryRun
from contextpolicy.actuators.order import Order


@pytest.fixture
def told(caplog):
    caplog.set_level("INFO")
    return caplog


def order(policy="lab/robot", **shares):
    return Order(policy, frozenset(shares), shares)


def test_it_says_what_it_would_do(told):
    DryRun().apply(order(slam=1500, speech=2000))
    assert told.messages == [
        "dry run: lab/robot would give slam a share of 1500m and a limit of 1500m",
        "dry run: lab/robot would give speech a share of 2 and a limit of 2",
    ]


def test_it_says_only_what_changes(told):
    dry_run = DryRun()
    dry_run.apply(order(slam=500, speech=500))
    told.clear()
    dry_run.apply(order(slam=500, speech=500))
    dry_run.apply(order(slam=500, speech=300))
    assert told.messages == ["dry run: lab/robot would give speech a share of 300m and a limit of 300m"]


def test_policies_are_told_apart(told):
    dry_run = DryRun()
    dry_run.apply(order(slam=500))
    dry_run.apply(order("lab/other", slam=500))
    assert len(told.messages) == 2


def test_where_nothing_is_capped_it_says_so(told):
    DryRun().apply(Order("lab/robot", frozenset(["slam"]), {"slam": 1500}, limits={"slam": None}))
    assert told.messages == ["dry run: lab/robot would give slam a share of 1500m and the limit it had"]
