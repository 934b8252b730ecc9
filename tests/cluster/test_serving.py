"""Whether anybody serves a namespace: the Lease says it, by the API server's clock."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from contextpolicy.cluster.serving import Service, service

NOW = datetime(2026, 11, 25, 12, 0, 0, tzinfo=UTC)


def a_lease(holder="system/first", renewed="2026-11-25T11:59:50.000000Z", noted=None):
    notes = [{"manager": "contextpolicy", "time": noted}] if noted else []
    return {
        "metadata": {"resourceVersion": "1", "managedFields": notes},
        "spec": {"holderIdentity": holder, "leaseDurationSeconds": 60 if holder else 1, "renewTime": renewed},
    }


@pytest.mark.parametrize(
    ("lease", "expected"),
    [
        (a_lease(), Service(served=True)),
        (a_lease(renewed="2026-11-25T11:58:45Z"), Service(served=False, silent=75)),
        # Its holder acts for four fifths of the 60 s.
        (a_lease(renewed="2026-11-25T11:59:12Z"), Service(served=True)),
        (a_lease(renewed="2026-11-25T11:59:11Z"), Service(served=False, silent=49)),
        # Given back.
        (a_lease(holder=""), Service(served=False, silent=10)),
        (None, Service(served=False)),
        (a_lease(renewed="soon"), Service(served=False)),
        # The holder's clock is an hour slow, or an hour fast.
        (a_lease(renewed="2026-11-25T11:00:00Z", noted="2026-11-25T11:59:50Z"), Service(served=True)),
        (a_lease(renewed="2026-11-25T13:00:00Z", noted="2026-11-25T11:58:00Z"), Service(served=False, silent=120)),
    ],
)
def test_lease_shows_whether_a_namespace_is_served(lease, expected):
    assert service(lease, NOW) == expected


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (Service(served=True), ""),
        (Service(served=False), "no operator serves namespace lab"),
        (Service(served=False, silent=75), "no operator has served namespace lab for 75 s"),
        (Service(served=False, silent=600), "no operator has served namespace lab for 10 min"),
        (Service(served=False, silent=300_000), "no operator has served namespace lab for 3 days"),
        (
            Service(served=None),
            "cannot tell whether an operator serves namespace lab: no permission to read its Lease",
        ),
    ],
)
def test_service_is_described_in_a_sentence(found, said):
    assert found.sentence("lab") == said
