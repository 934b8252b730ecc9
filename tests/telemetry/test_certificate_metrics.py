"""When a certificate ends, as a metric; one that can't be read must not look like none."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import pytest
from prometheus_client import REGISTRY

from contextpolicy.bus.issuing import AUTHORITY_LIFETIME, LIFETIME, found_authority, pem
from contextpolicy.telemetry import certificate_metrics

NOW = datetime(2026, 11, 24, tzinfo=UTC)


@pytest.fixture(autouse=True)
def _forget():
    yield
    certificate_metrics.EXPIRY.clear()


def expiry():
    name = "contextpolicy_certificate_expiry_timestamp_seconds"
    return REGISTRY.get_sample_value(name, {"component": "operator"})


@pytest.mark.parametrize("text", ["", "no certificate"])
def test_the_expiry_of_an_unreadable_certificate_is_nan(tmp_path, text):
    (tmp_path / "tls.crt").write_text(text)
    certificate_metrics.publish_expiry("operator", tmp_path)
    assert math.isnan(expiry())


def test_the_expiry_of_a_removed_certificate_is_nan(tmp_path):
    (tmp_path / "tls.crt").write_text("")
    certificate_metrics.publish_expiry("operator", tmp_path)
    (tmp_path / "tls.crt").unlink()
    assert math.isnan(expiry())


def test_no_expiry_without_a_certificate(tmp_path):
    certificate_metrics.publish_expiry("operator", None)
    (tmp_path / "username").write_text("operator")
    certificate_metrics.publish_expiry("operator", tmp_path)
    assert expiry() is None


def test_the_expiry_without_a_matching_key_is_nan(tmp_path):
    issuer = found_authority("bus", NOW)
    files = issuer.issue("operator", (), NOW)
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    certificate_metrics.publish_expiry("operator", tmp_path)
    assert expiry() == (NOW + LIFETIME).timestamp()
    (tmp_path / "tls.key").write_bytes(issuer.issue("operator", (), NOW)["tls.key"])
    assert math.isnan(expiry())


def test_a_certificate_ends_with_the_last_authority_that_is_trusted(tmp_path):
    """cert-manager renews an authority, but not the `ca.crt` of a Secret whose own certificate is still good."""
    early, late = (found_authority("bus", NOW - AUTHORITY_LIFETIME + timedelta(days=days)) for days in (30, 2 * 365))
    for name, content in {**late.issue("operator", (), NOW), "ca.crt": pem([early.certificate])}.items():
        (tmp_path / name).write_bytes(content)
    certificate_metrics.publish_expiry("operator", tmp_path)
    assert expiry() == (NOW + timedelta(days=30)).timestamp()
    (tmp_path / "ca.crt").write_bytes(pem([early.certificate, late.certificate]))
    assert expiry() == (NOW + LIFETIME).timestamp()
    (tmp_path / "ca.crt").write_text("no certificate")
    assert math.isnan(expiry())
