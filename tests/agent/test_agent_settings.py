"""The agent's settings."""

from __future__ import annotations

from pathlib import Path

import pytest

from contextpolicy.agent.agent_settings import read
from contextpolicy.errors import SettingsError


def test_settings_come_from_the_environment(tmp_path):
    own = read(
        {
            "NODE_NAME": "node-1",
            "CGROUP_ROOT": str(tmp_path),
            "POD_LOGS": str(tmp_path),
            "PLAN_SIGNING": str(tmp_path),
            "ZENOH_CONNECT": "tcp/r:1",
        },
        priority=10,
        grace=2,
    )
    assert (own.keys, own.logs) == (tmp_path, tmp_path)
    assert (own.node, own.cgroup_root, own.connect) == ("node-1", tmp_path, ("tcp/r:1",))
    assert (own.grace, own.priority, own.state) == (2, 10, Path("/run/contextpolicy"))


@pytest.mark.parametrize(
    ("environment", "name"),
    [
        ({}, "NODE_NAME"),
        ({"NODE_NAME": "a/b"}, "NODE_NAME"),
        ({"NODE_NAME": "a", "CGROUP_ROOT": "/no/such/mount"}, "CGROUP_ROOT"),
        ({"NODE_NAME": "a", "POD_LOGS": "/no/such/mount"}, "POD_LOGS"),
        ({"NODE_NAME": "a"}, "PLAN_SIGNING"),
        ({"NODE_NAME": "a", "ZENOH_CREDENTIALS": "/no/such/secret"}, "ZENOH_CREDENTIALS"),
        ({"NODE_NAME": "a", "LOG_LEVEL": "loud"}, "LOG_LEVEL"),
    ],
)
def test_an_invalid_setting_is_named(environment, name):
    with pytest.raises(SettingsError, match=name):
        read(environment, priority=10, grace=10)
