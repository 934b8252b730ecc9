"""Write the originals into the policies' status: at once, one write per policy, retried until it succeeds."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize.pauses import FAILED, REFUSED
from contextpolicy.errors import ActuationError, unexpected

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.actuators.resize.background import Background
    from contextpolicy.actuators.resize.dispatcher import Observer
    from contextpolicy.actuators.resize.originals import Originals
    from contextpolicy.actuators.resize.pod_patch import ResizeApi

log = logging.getLogger(__name__)

SUBJECT = "its status"
"""The subject of a failed write, where other problems name a pod."""


@dataclass(slots=True)
class _Retry:
    """How often in a row a policy's write has failed, and the loop time at which the next may be sent."""

    times: int = 0
    due: float = -inf


class RecordListener(Protocol):
    """Continues when a status was written; called on the loop's thread."""

    def on_record_end(self, policy: str) -> None:
        """A write to the policy's status has ended, well or not."""


class StatusRecord:
    """At most one write per policy is under way."""

    def __init__(
        self,
        originals: Originals,
        api: ResizeApi,
        background: Background,
        observer: Observer,
        listener: RecordListener,
    ) -> None:
        self._originals, self._api, self._background = originals, api, background
        self._observer, self._listener = observer, listener
        self._retries: dict[str, _Retry] = {}

    def write(self, policy: str, now: float) -> float:
        """Send the missing changes; returns when to call again if they have to wait, else infinity."""
        changes = self._originals.changes(policy)
        if not changes:
            return inf
        retry = self._retries.setdefault(policy, _Retry())
        if retry.due > now:
            return retry.due
        self._originals.send(policy)
        self._background.run(lambda: self._write(policy, changes), lambda answer: self._ended(policy, retry, answer))
        return inf

    def inspect(self, policy: str, raw: Mapping[str, Any], version: int) -> bool:
        """Compare with what the watch shows of a policy's status; whether it has to be written."""
        changed = self._originals.inspect(policy, raw, version)
        if changed:
            self._observer.on_changed_by_other(policy)
        return changed

    def forget(self, policy: str) -> None:
        """The policy is gone, and its status with it."""
        self._originals.forget(policy)
        self._retries.pop(policy, None)

    def _write(self, policy: str, changes: dict[str, object]) -> int | ActuationError:
        """On a worker's thread."""
        namespace, _, name = policy.partition("/")
        try:
            return self._api.write_originals(namespace, name, changes)
        except ActuationError as error:
            return error
        except Exception as error:
            log.exception("the originals of %s could not be written", policy)
            return unexpected(error)

    def _ended(self, policy: str, retry: _Retry, answer: int | ActuationError) -> None:
        if self._retries.get(policy) is not retry:  # the policy was deleted meanwhile: one of its name is another
            return
        error = answer if isinstance(answer, ActuationError) else None
        if error is not None or retry.times:
            self._observer.on_problem(policy, SUBJECT, error)
        if isinstance(answer, ActuationError):
            self._failed(policy, retry, answer)
        else:
            self._retries[policy] = _Retry()
            if self._originals.succeed(policy, answer):
                self._observer.on_changed_by_other(policy)
        self._listener.on_record_end(policy)

    def _failed(self, policy: str, retry: _Retry, error: ActuationError) -> None:
        self._originals.fail(policy)
        retry.times += 1
        pause = (FAILED if error.retriable else REFUSED).after(retry.times)
        retry.due = self._background.now() + max(pause, error.retry_after)
