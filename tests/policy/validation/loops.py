"""Policies of a robot that listens and moves, and what `validate` says of the loops in them."""

from __future__ import annotations

import yaml

from contextpolicy.policy.validation.check import check
from contextpolicy.policy.validation.problem import Severity

MIC = {"name": "mic", "key": "robot/mic", "producedBy": "speech"}
IMU = {"name": "imu", "key": "robot/imu"}


def a_task(name, **fields):
    return {"name": name, "selector": {"matchLabels": {"app": name}}, **fields}


TASKS = [a_task("speech"), a_task("slam")]


def a_context(name="quiet", when="mic.level < 0.1", *, suspends="speech", **fields):
    effects = {"tasks": {suspends: {"suspend": True}}} if suspends else {"tasks": {"slam": {"weight": 1}}}
    return {"name": name, "when": when, "exitAfter": "1s", **effects, **fields}


QUIET = a_context()
NO_LOOP = ("nothing reads", "counts for ever", "on its last sample")
"""What is reported for policies as short as these."""


def warned(**spec):
    """All but what is not about loops."""
    return [one for one in advised(**spec) if not any(words in one for words in NO_LOOP)]


def advised(streams=(MIC, IMU), tasks=TASKS, contexts=(QUIET,), **spec):
    body = {
        "apiVersion": "contextpolicy.dev/v1alpha1",
        "kind": "ContextPolicy",
        "metadata": {"name": "p", "namespace": "lab"},
        "spec": {"streams": [*streams], "tasks": [*tasks], "contexts": [*contexts], **spec},
    }
    problems = check([("p.yaml", yaml.safe_dump(body))]).problems
    assert all(problem.severity is Severity.WARNING for problem in problems), problems
    return [one.message for one in problems]


LATCHED = "nothing else ends it, so once begun it holds for ever"
COMES_AND_GOES = "its silence ends the context, the task resumes, and the cycle repeats"
STALE = {**MIC, "staleAfter": "1s"}
COUNTED = {**MIC, "features": [{"name": "often", "op": "count", "over": "5s"}]}
