"""Writes statuses and events off the hot path: the newest status wins."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.errors import ActuationError, unexpected

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from concurrent.futures import Executor

    from reactivex.abc import SchedulerBase

log = logging.getLogger(__name__)

STATUS_INTERVAL = 1.0
"""Seconds between two status writes of one policy: a storm of plans must not become a storm of writes."""
STATUS_DELAY = 0.1
"""Seconds before a status is written: the plan's resizes go first, since on two cores both compete for CPU."""
STATUS_RETRY = 2.0
"""Seconds before a failed status write is retried."""


class ReportApi(Protocol):
    """What the reporter needs of the API server; both raise ActuationError."""

    def write_status(self, namespace: str, name: str, status: Mapping[str, Any]) -> None:
        """Write a policy's status."""

    def post_event(self, namespace: str, event: Mapping[str, Any]) -> None:
        """Create an Event."""


class Reporter:
    """Called on the loop's thread. `worker` must have one thread, so that the newest status is written last."""

    def __init__(self, api: ReportApi, scheduler: SchedulerBase, worker: Executor) -> None:
        self._api, self._scheduler, self._worker = api, scheduler, worker
        self._pending: dict[str, Callable[[], dict[str, Any]]] = {}
        self._resting: set[str] = set()
        self._sent: dict[str, dict[str, Any]] = {}
        self._written: dict[str, dict[str, Any]] = {}

    def status(self, policy: str, make: Callable[[], dict[str, Any]]) -> None:
        """Have the status that `make` returns written soon; of several calls only the last counts.

        `make` is called on the loop's thread.
        """
        self._pending[policy] = make
        if policy not in self._resting:
            self._resting.add(policy)
            self._scheduler.schedule_relative(STATUS_DELAY, lambda *_: self._rested(policy))

    def forget(self, policy: str) -> None:
        """The policy is gone: write nothing more for it."""
        self._pending.pop(policy, None)
        self._sent.pop(policy, None)
        self._written.pop(policy, None)

    def event(self, event: Mapping[str, Any]) -> None:
        """Post an event. There is no deduplication here: the caller knows that it is news."""
        self._worker.submit(self._post, event)

    def close(self) -> None:
        """Finish the write in progress and drop the queued ones."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    def _write(self, policy: str) -> None:
        status = self._pending.pop(policy)()
        if status == self._written.get(policy):
            return
        self._sent[policy] = status
        self._resting.add(policy)
        self._worker.submit(self._send, policy, status)

    def _send(self, policy: str, status: dict[str, Any]) -> None:
        rest = STATUS_INTERVAL
        namespace, name = policy.split("/")
        error = _outcome(lambda: self._api.write_status(namespace, name, status))
        if error is not None:
            rest = STATUS_RETRY if error.retriable else STATUS_INTERVAL
            log.log(logging.INFO if error.reason == "NotFound" else logging.WARNING, "status of %s: %s", policy, error)
            if error.retriable:
                self._scheduler.schedule(lambda *_: self._keep(policy, status))
        else:
            self._scheduler.schedule(lambda *_: self._note(policy, status))
        self._scheduler.schedule_relative(rest, lambda *_: self._rested(policy))

    def _note(self, policy: str, status: dict[str, Any]) -> None:
        """The API server has this status: the same again would be no news."""
        if self._sent.get(policy) is status:
            self._written[policy] = status

    def _keep(self, policy: str, status: dict[str, Any]) -> None:
        """Queue the failed status again, unless there is a newer one or the policy is gone."""
        if self._sent.get(policy) is status:
            self._pending.setdefault(policy, lambda: status)

    def _rested(self, policy: str) -> None:
        self._resting.discard(policy)
        if policy in self._pending:
            self._write(policy)

    def _post(self, event: Mapping[str, Any]) -> None:
        error = _outcome(lambda: self._api.post_event(event["metadata"]["namespace"], event))
        if error is not None:
            log.warning("event %s: %s", event["reason"], error)


def _outcome(write: Callable[[], None]) -> ActuationError | None:
    """Why the write failed, or None.

    Unexpected exceptions are outcomes too: if one escaped, `_rested` would never run and the policy's status would
    never be written again.
    """
    try:
        write()
    except ActuationError as error:
        return error
    except Exception as error:
        log.exception("internal error")
        return unexpected(error)
    return None
