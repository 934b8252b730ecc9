"""One patch of a pod, with the note of what was there before; runs on a worker's thread."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from contextpolicy.actuators.resize.patches import resize_patch
from contextpolicy.cluster.pods import ORIGINALS, write_originals
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.pods import Cpu, Original, PodView


class ResizeApi(Protocol):
    """What the resizer needs of the API server; answers are the version of the pod that has the change."""

    def resize(self, namespace: str, pod: str, patch: Mapping[str, object]) -> int:
        """PATCH pods/resize."""

    def annotate(self, namespace: str, pod: str, annotations: Mapping[str, str | None]) -> int:
        """Set or remove annotations."""


@dataclass(frozen=True, slots=True)
class Job:
    """What a patch asks for: `changed` of `wanted` differs from what the API has, `originals` is the note after it.

    The note of what was there is written before the first resize; a restore takes it away after the last.
    """

    policy: str
    view: PodView
    wanted: Mapping[str, Cpu]
    changed: Mapping[str, Cpu]
    originals: Mapping[str, Original]
    note: bool
    restore: bool = False


@dataclass(slots=True)
class Outcome:
    """How far a job came: `version` is that of its last answered write, `error` what ended it.

    `answered` is the monotonic time at which the API had accepted all of it.
    """

    version: int = 0
    noted: bool = False
    resized: bool = False
    answered: float = 0.0
    error: ActuationError | None = None


def carry_out(api: ResizeApi, job: Job) -> Outcome:
    """Send the job's patches in the order in which an end at any of them loses nothing."""
    outcome = Outcome()
    try:
        if job.note and not job.restore:
            _note(api, job, outcome)
        if job.changed:
            patch = resize_patch(job.view, job.changed)
            outcome.version, outcome.resized = api.resize(job.view.namespace, job.view.name, patch), True
        outcome.answered = time.monotonic()
        if job.note and job.restore:
            _note(api, job, outcome)
    except ActuationError as error:
        outcome.error = error
    return outcome


def _note(api: ResizeApi, job: Job, outcome: Outcome) -> None:
    annotations = {ORIGINALS: write_originals(job.originals)}
    outcome.version, outcome.noted = api.annotate(job.view.namespace, job.view.name, annotations), True
