"""Writes statuses and events off the hot path: the newest status wins, and as few are written as people need."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Protocol

from reactivex.disposable import SerialDisposable

from contextpolicy.errors import ActuationError, unexpected
from contextpolicy.telemetry.status_budget import BURST, REFILL, reserve
from contextpolicy.telemetry.token_bucket import TokenBucket

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


class _Desk:
    """What was written about one policy, and when more may be; nothing any more once the timer is disposed of."""

    def __init__(self, policy: str) -> None:
        self.policy = policy
        self.written: dict[str, Any] | None = None
        """What the API server has: the same again would be no news."""
        self.budget = TokenBucket(BURST, REFILL)
        self.resting = False
        """Whether nothing may be made yet, whatever it is."""
        self.timer = SerialDisposable()

    def note(self, status: dict[str, Any]) -> None:
        """The API server has it."""
        self.written = status
        self.budget.spend()


class Reporter:
    """Called on the loop's thread. `worker` must have one thread, so that the newest status is written last."""

    def __init__(self, api: ReportApi, scheduler: SchedulerBase, worker: Executor) -> None:
        self._api, self._scheduler, self._worker = api, scheduler, worker
        self._pending: dict[str, Callable[[], dict[str, Any]]] = {}
        self._desks: dict[str, _Desk] = {}

    def status(self, policy: str, make: Callable[[], dict[str, Any]]) -> None:
        """Have the status that `make` returns written soon; of several calls only the last counts.

        `make` is called on the loop's thread.
        """
        desk = self._desks.get(policy)
        if desk is None:
            desk = self._desks[policy] = _Desk(policy)
        delay = STATUS_INTERVAL if policy in self._pending else STATUS_DELAY
        self._pending[policy] = make
        if not desk.resting:
            desk.resting = True
            self._look_in(desk, delay)

    def forget(self, policy: str) -> None:
        """The policy is gone: write nothing more for it."""
        self._pending.pop(policy, None)
        desk = self._desks.pop(policy, None)
        if desk is not None:
            desk.timer.dispose()

    def event(self, event: Mapping[str, Any]) -> None:
        """Post an event. There is no deduplication here: the caller knows that it is news."""
        self._worker.submit(self._post, event)

    def close(self) -> None:
        """Finish the write in progress and drop the queued ones."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    def _look_in(self, desk: _Desk, seconds: float) -> None:
        desk.timer.disposable = self._scheduler.schedule_relative(seconds, lambda *_: self._look(desk))

    def _look(self, desk: _Desk) -> None:
        """Write what is news, or look again when the budget has room for it."""
        desk.resting = False
        make = self._pending.get(desk.policy)
        status = make() if make is not None else desk.written
        if status is None or status == desk.written:
            self._pending.pop(desk.policy, None)
            return
        wait = desk.budget.wait(self._scheduler.to_seconds(self._scheduler.now), reserve(desk.written, status))
        if wait:
            self._look_in(desk, wait)
            return
        desk.resting = True
        del self._pending[desk.policy]
        self._worker.submit(self._send, desk, status)

    def _send(self, desk: _Desk, status: dict[str, Any]) -> None:
        rest = STATUS_INTERVAL
        namespace, name = desk.policy.split("/")
        error = _outcome(lambda: self._api.write_status(namespace, name, status))
        if error is not None:
            rest = STATUS_RETRY if error.retriable else STATUS_INTERVAL
            level = logging.INFO if error.reason == "NotFound" else logging.WARNING
            log.log(level, "status of %s: %s", desk.policy, error)
        self._scheduler.schedule(lambda *_: self._sent(desk, status, error, rest))

    def _sent(self, desk: _Desk, status: dict[str, Any], error: ActuationError | None, rest: float) -> None:
        if error is None:
            desk.note(status)
        elif error.retriable and desk is self._desks.get(desk.policy):
            self._pending.setdefault(desk.policy, lambda: status)
        self._look_in(desk, rest)

    def _post(self, event: Mapping[str, Any]) -> None:
        error = _outcome(lambda: self._api.post_event(event["metadata"]["namespace"], event))
        if error is not None:
            log.warning("event %s: %s", event["reason"], error)


def _outcome(write: Callable[[], None]) -> ActuationError | None:
    """Why the write failed, or None.

    Unexpected exceptions are outcomes too: if one escaped, `_sent` would never run and the policy's status would never
    be written again.
    """
    try:
        write()
    except ActuationError as error:
        return error
    except Exception as error:
        log.exception("internal error")
        return unexpected(error)
    return None
