from __future__ import annotations

import pytest

from contextpolicy.app.settings import Settings, read
from contextpolicy.cluster.lease import OwnPod
from contextpolicy.errors import SettingsError
from contextpolicy.policy.tenants import Tenant, Tenants


def test_without_any_variable_the_defaults_hold():
    assert read({}) == Settings()


def test_empty_variable_means_the_default():
    names = ("ZENOH_CONNECT", "WATCH_NAMESPACES", "TENANTS", "HEALTH_PORT", "METRICS_PORT", "LOG_FORMAT", "LOG_LEVEL")
    assert read(dict.fromkeys(names, "")) == Settings()


def test_every_variable_is_read():
    environment = {
        "ZENOH_CONNECT": "tcp/router:7447, tls/10.0.0.1:7448",
        "WATCH_NAMESPACES": "robot,,lab ",
        "TENANTS": '{"lab": {"priority": 10, "streamPrefixes": ["robot"]}}',
        "HEALTH_PORT": "9080",
        "METRICS_PORT": "9081",
        "LEASE": "system/contextpolicy",
        "LEASE_SECONDS": "1",
        "LEASE_POD": "pod-1/uid-1",
        "ORIGINALS_KEY": "system/contextpolicy-originals",
        "AGENTS": "everywhere",
        "SETTLE_SECONDS": "5",
        "IDENTITY": "pod-1",
        "LOG_FORMAT": "JSON",
        "LOG_LEVEL": "Debug",
        "PATH": "/usr/bin",
    }
    assert read(environment) == Settings(
        connect=("tcp/router:7447", "tls/10.0.0.1:7448"),
        namespaces=("robot", "lab"),
        tenants=Tenants({"lab": Tenant(10, ("robot",))}),
        health_port=9080,
        metrics_port=9081,
        lease=("system", "contextpolicy"),
        lease_seconds=1,
        lease_pod=OwnPod("pod-1", "uid-1"),
        originals_key=("system", "contextpolicy-originals"),
        agents_everywhere=True,
        settle_seconds=5,
        identity="pod-1",
        log_format="json",
        log_level="debug",
    )


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("HEALTH_PORT", "0", "a port from 1 to 65535"),
        ("HEALTH_PORT", "65536", "a port from 1 to 65535"),
        ("METRICS_PORT", "http", "a port from 1 to 65535"),
        ("METRICS_PORT", "-1", "a port from 1 to 65535"),
        ("METRICS_PORT", "8²", "a port from 1 to 65535"),
        ("LOG_FORMAT", "xml", "one of text, json"),
        ("LOG_LEVEL", "loud", "one of debug, info, warning, error"),
        ("ORIGINALS_KEY", "x", "a namespace and a Secret's name, such as contextpolicy-system/contextpolicy-originals"),
        ("LEASE", "contextpolicy", "a namespace and a name, such as contextpolicy-system/contextpolicy"),
        ("LEASE", "a/b/c", "a namespace and a name, such as contextpolicy-system/contextpolicy"),
        ("LEASE_POD", "pod-1", "a pod's name and UID, such as contextpolicy-1/d9607e19"),
        ("LEASE_SECONDS", "0", "whole seconds from 1 to 60"),
        ("LEASE_SECONDS", "61", "whole seconds from 1 to 60"),
        ("LEASE_SECONDS", "1.5", "whole seconds from 1 to 60"),
        ("SETTLE_SECONDS", "0", "whole seconds from 1 to 3600"),
        ("ZENOH_CONNECT", "router:7447", "endpoints such as tcp/router:7447, comma separated"),
    ],
)
def test_an_invalid_value_is_named_with_what_is_allowed(name, value, allowed):
    with pytest.raises(SettingsError) as caught:
        read({name: value})
    assert [(f.field, str(f.value), f.allowed) for f in caught.value.findings] == [(name, value.lower(), allowed)]


def test_duplicate_ports_are_rejected():
    with pytest.raises(SettingsError) as caught:
        read({"HEALTH_PORT": "9000", "METRICS_PORT": "9000", "LIVE_PORT": "9000"})
    assert [str(finding) for finding in caught.value.findings] == [
        "METRICS_PORT: invalid value '9000': expected a port other than HEALTH_PORT",
        "LIVE_PORT: invalid value '9000': expected a port other than HEALTH_PORT",
        "LIVE_PORT: invalid value '9000': expected a port other than METRICS_PORT",
    ]


def test_all_mistakes_are_reported_at_once():
    with pytest.raises(SettingsError) as caught:
        read(
            {"TENANTS": "x", "HEALTH_PORT": "x", "METRICS_PORT": "y", "LOG_LEVEL": "z", "ZENOH_CONNECT": "a,tcp/b:1,c"}
        )
    assert [f.field for f in caught.value.findings] == [
        *("ZENOH_CONNECT", "ZENOH_CONNECT", "TENANTS", "HEALTH_PORT", "METRICS_PORT", "LOG_LEVEL")
    ]
