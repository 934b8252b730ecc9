"""Messages as Kubernetes 1.36 writes them -> what to do."""

from __future__ import annotations

import pytest

from contextpolicy.errors import ActuationError
from contextpolicy.telemetry import remedies


@pytest.mark.parametrize(
    ("message", "remedy"),
    [
        (
            'pods "slam" is forbidden: exceeded quota: cpu, requested: limits.cpu=9, used: limits.cpu=1, limited: 5',
            "raise the ResourceQuota",
        ),
        (
            'pods "slam" is forbidden: maximum cpu usage per Container is 600m, but limit is 990m',
            "widen the LimitRange",
        ),
        (
            'pods "slam" is forbidden: cpu max limit to request ratio per Container is 2, but provided ratio is 9.9',
            "widen the LimitRange",
        ),
        (
            'pods "slam" is forbidden: User "u" cannot patch resource "pods/resize" in API group ""',
            "allow the operator's role",
        ),
        ("[0][cpu].limits: Invalid value: must be less than or equal to pod limits of 500m", "the pod has resources"),
        ("must be greater than or equal to aggregate container requests of 600m", "the pod has resources"),
        (
            "node didn't have enough allocatable resources: cpu, requested: 3000, allocatable: 2000",
            "raise the policy's reserve",
        ),
        (
            'admission webhook "no.example.com" denied the request: no',
            "allow the operator's resizes in that admission policy or webhook",
        ),
        (
            "pods \"slam\" is forbidden: ValidatingAdmissionPolicy 'x' with binding 'x' denied request: no",
            "allow the operator's resizes in that",
        ),
        ("Pod QOS Class may not change as a result of resizing", ""),
    ],
)
def test_remedy_for_a_refusal(message, remedy):
    reported = remedies.for_refusal(ActuationError("Forbidden", message, retriable=False))
    assert reported.startswith(remedy)
    assert bool(reported) == bool(remedy)


@pytest.mark.parametrize(
    ("pending", "remedy"),
    [
        ("Deferred: Node didn't have enough resource: cpu", "its CPU request does not fit"),
        (
            'Infeasible: Resize is infeasible for Guaranteed Pods alongside CPU Manager policy "static"',
            "a static CPU manager can't resize Guaranteed pods",
        ),
        ("Infeasible: Node didn't have enough capacity", "this node can't resize the pod"),
        ("Error: EINVAL", "the kubelet retries"),
        ("", ""),
    ],
)
def test_remedy_for_a_deferred_resize(pending, remedy):
    reported = remedies.for_pending(pending)
    assert reported.startswith(remedy)
    assert bool(reported) == bool(remedy)


@pytest.mark.parametrize(
    ("manager", "remedy"),
    [
        ("vpa-updater", 'set updateMode: "Off"'),
        ("updater", 'set updateMode: "Off"'),
        ("kube-startup-cpu-boost", "exclude this pod"),
        ("kubectl-patch", "change the policy instead"),
        ("contextpolicy", "an admission webhook"),
        ("", "an admission webhook"),
        ("my-autoscaler", "let only one of them set its CPU"),
        ("contextpolicy-exporter", "let only one of them set its CPU"),
    ],
)
def test_remedy_for_another_writer(manager, remedy):
    assert remedies.for_writer(manager).startswith(remedy)
