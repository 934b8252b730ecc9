"""Policies and pods that claim, and what they get."""

from __future__ import annotations

from dataclasses import replace

from contextpolicy.cluster.pod_parsing import view
from tests.cluster.builders import NODE, a_pod
from tests.planning.builders import a_policy, a_task

NODES = {NODE: 2000}


def policy_of(name, *tasks, **spec):
    return replace(a_policy(tasks=[a_task(t) if isinstance(t, str) else t for t in tasks], **spec), name=name)


def views(*names, **fields):
    return [view(a_pod(name, **fields)) for name in names]


def held(result):
    return {container.id: container.task for container in result.placement.containers}
