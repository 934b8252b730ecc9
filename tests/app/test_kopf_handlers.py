"""What kopf's handlers pass to the operator, and what they return to kopf."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import kopf
import pytest

from contextpolicy.app import kopf_handlers
from contextpolicy.policy.custom_resource import GROUP
from tests.small_cluster import Recorder

APPLY: Any = kopf_handlers.apply
CONFIGURE: Any = kopf_handlers.configure
RELEASE: Any = kopf_handlers.release
SEE: Any = kopf_handlers.see
"""Kopf calls them with two dozen arguments; they take what they need."""


def run(coroutine):
    return asyncio.run(coroutine)


def memo(reported):
    return SimpleNamespace(operator=reported.operator)


@pytest.fixture
def reported():
    return Recorder()


def test_a_policy_is_handed_over_as_a_plain_object(reported):
    run(APPLY(body=kopf.Body({"metadata": {"name": "robot"}, "spec": {}}), memo=memo(reported)))
    assert reported.calls == [("policy_changed", "robot")]
    assert type(reported.operator.policy_changed.call_args.args[0]) is dict


def test_unreadable_policy_is_retried_later(reported):
    reported.readable = False
    with pytest.raises(kopf.TemporaryError) as caught:
        run(APPLY(body=kopf.Body({"metadata": {"name": "robot"}, "spec": {}}), memo=memo(reported)))
    assert caught.value.delay == kopf_handlers.REREAD


def test_finalizer_completes_once_everything_is_restored(reported):
    reported.restored.set_result(None)
    run(RELEASE(body=kopf.Body({"metadata": {"name": "robot"}}), memo=memo(reported)))
    assert reported.calls == [("policy_deleted", "robot")]


def test_slow_restore_is_retried(monkeypatch, reported):
    monkeypatch.setattr(kopf_handlers, "RESTORE_TIMEOUT", 0.01)
    with pytest.raises(kopf.TemporaryError, match="not restored yet"):
        run(RELEASE(body=kopf.Body({"metadata": {"name": "robot"}}), memo=memo(reported)))
    assert reported.restored.cancelled(), "the operator may skip an answer that nobody awaits"


@pytest.mark.parametrize("kind", [None, "ADDED", "MODIFIED"])
def test_edits_and_status_changes_of_a_policy_reach_the_operator(reported, kind):
    run(SEE(type=kind, body=kopf.Body({"metadata": {"name": "robot"}}), memo=memo(reported)))
    assert reported.calls == [("policy_seen", "robot")]


def test_deletion_of_a_policy_reaches_the_operator_from_kopf_too(reported):
    """After the handlers that kopf has begun; the watch of policies may report it while one still reads ConfigMaps."""
    run(SEE(type="DELETED", body=kopf.Body({"metadata": {"name": "robot", "uid": "uid-robot"}}), memo=memo(reported)))
    assert reported.calls == [("policy_gone", "uid-robot")]


def stored(body):
    """What kopf would write into the object to recognise the next edit."""
    settings, patch = kopf.OperatorSettings(), kopf.Patch()
    run(CONFIGURE(settings, memo=SimpleNamespace()))
    storage, whole = settings.persistence.diffbase_storage, kopf.Body(body)
    storage.store(body=whole, patch=patch, essence=storage.build(body=whole))
    return dict(patch.metadata.annotations)


def test_kopf_annotations_stay_small_for_a_large_policy():
    """Kubernetes refuses more than 256 KiB of annotations: the policy was not taken up, and could never be deleted."""
    large = {"metadata": {"annotations": {"notes": "x" * 200_000}}, "spec": {"streams": ["y" * 1_000_000]}}
    assert sum(map(len, stored(large).values())) < 1000


@pytest.mark.parametrize(
    ("edited", "differs"),
    [
        ({"spec": {"reserve": "2"}}, True),
        ({"metadata": {"annotations": {"notes": "new"}}}, True),
        ({"metadata": {"annotations": {"kubectl.kubernetes.io/last-applied-configuration": "{}"}}}, False),
        ({"metadata": {"resourceVersion": "2"}}, False),
        ({"status": {"contexts": "moving"}}, False),
    ],
)
def test_kopf_recognises_an_edit(edited, differs):
    body = {"metadata": {"annotations": {}}, "spec": {"reserve": "1"}}
    assert (stored({**body, **edited}) != stored(body)) is differs


def test_policy_applied_from_an_export_is_not_taken_for_handled():
    """The export has kopf's annotation of the object that it was copied from."""
    metadata = {"name": "robot", "uid": "one", "annotations": {}}
    body = {"metadata": metadata, "spec": {"reserve": "1"}}
    copy = {**body, "metadata": {**metadata, "uid": "other", "annotations": stored(body)}}
    handled = f"{GROUP}/last-handled-configuration"
    assert stored(copy)[handled] != stored(body)[handled]
