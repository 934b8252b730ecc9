"""One replica of the operator: gets ready, stands by until it leads, then runs kopf for the namespaces that it serves.

A standby knows all pods and nodes and has the bus already, so that it decides as soon as it leads; it changes nothing.
"""

from __future__ import annotations

import logging
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Condition, Event, Thread
from typing import TYPE_CHECKING, NoReturn

from contextpolicy.app.kopf_thread import KopfThread
from contextpolicy.app.leadership import Leadership
from contextpolicy.app.probes import HUNG, Heartbeat
from contextpolicy.app.watches import Watches
from contextpolicy.app.wiring import Operator
from contextpolicy.bus.session import open_client
from contextpolicy.bus.signatures import Signer
from contextpolicy.cluster.api import ApiServer
from contextpolicy.errors import ActuationError
from contextpolicy.streams.loop import Loop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from contextpolicy.app.settings import Settings

log = logging.getLogger(__name__)

PATCH_WORKERS = 8
"""Concurrent patches: enough for one robot's tasks; more would only queue in the API server."""
PAUSES = (0.1, 0.2, 0.5, 1.0)
"""Seconds between attempts to find the API server at the start; the last one repeats."""
NOT_INSTALLED = "the custom resource is not installed: kubectl apply -f crds/"


def reach(stop: Event, on_answer: Callable[[str, str], object]) -> ApiServer | None:
    """The API server, as soon as it answers and has the custom resource; None when `stop` is set first."""
    reported = ""
    for pause in _pauses():
        try:
            api = ApiServer(on_answer)
            problem = "" if api.serves_policies() else NOT_INSTALLED
        except ActuationError as error:
            if not error.retriable and error.reason == "NoCluster":
                raise
            problem = str(error)
        if not problem:
            return api
        if problem != reported:
            log.warning("not started yet: %s", problem)
            reported = problem
        if stop.wait(pause):
            break
    return None


class Supervisor:
    """One replica from start to end; `restart` begins a new process with nothing kept, and does not return."""

    def __init__(self, api: ApiServer, settings: Settings, restart: Callable[[], NoReturn]) -> None:
        self._api, self._settings, self._restart = api, settings, restart
        self._news, self._woken = Condition(), False
        self._leadership = Leadership(api, settings, self._wake)
        loop = Loop()
        self.operator = Operator(
            api,
            self._leadership,
            loop,
            patches=ThreadPoolExecutor(PATCH_WORKERS, thread_name_prefix="patch"),
            reports=ThreadPoolExecutor(1, thread_name_prefix="report"),
            signer=Signer(settings.signing) if settings.signing else None,
            tenants=settings.tenants,
        )
        self._heartbeat = Heartbeat(lambda beat: loop.schedule(lambda *_: beat()))
        self._watches = Watches(api, settings.namespaces, self.operator, self._wake)
        self._kopf: KopfThread | None = None
        self._kopf_heartbeat: Heartbeat | None = None
        self._interruptions = 0
        self._stop = Event()
        self._connecting = Thread(target=self._connect, name="connect", daemon=True)

    def run(self, stop: Event) -> int:
        """Run until `stop` is set, then give the Lease back; the exit code."""
        self._watches.start()
        self._connecting.start()
        self._leadership.start()
        Thread(target=self._await, args=(stop,), name="stop", daemon=True).start()
        try:
            while not (stop.is_set() or (self._kopf is not None and self._kopf.failed)):
                self._follow_leadership()
                self._sleep()
            return 1 if self._kopf is not None and self._kopf.failed else 0
        finally:
            self._close()

    def hung(self) -> list[str]:
        """The parts of the process that do nothing any more; anything else is no reason for a restart."""
        return [*self._ended(), *self._late()]

    def unready(self) -> list[str]:
        """Why this replica does not decide, or could not as soon as it leads."""
        unlisted = self._watches.unlisted()
        problems = [f"not listed yet: {', '.join(unlisted)}"] if unlisted else []
        if not self.operator.has_router:
            problems.append("no Zenoh router answers")
        if not (self._leadership.leads or self._leadership.follows):
            problems.append("the Lease is not ours, and nobody was seen to renew it")
        return [*problems, *self.hung()]

    def _follow_leadership(self) -> None:
        """Run kopf for what is ours, once all pods and nodes are known.

        Before that, a policy being deleted would seem to have no containers left, and would lose its finalizer.
        """
        if self._leadership.deposed:
            log.warning("another replica leads: restarting as its standby")
            self._restart()
        if not self._leadership.leads or self._watches.unlisted():
            return
        self._leadership.serve(self._watches.served())
        served = self._leadership.served
        if served is not None and served != (self._kopf.namespaces if self._kopf else frozenset()):
            self._serve(served)
        if self._leadership.interruptions != self._interruptions:
            self._interruptions = self._leadership.interruptions
            self.operator.resume()

    def _serve(self, namespaces: frozenset[str]) -> None:
        log.info("serving %s", ", ".join(sorted(namespaces)) or "no namespace")
        if self._kopf is not None:
            self._kopf.stop()
            for lost in self._kopf.namespaces - namespaces:
                self.operator.abandon(lost)
        self._kopf = KopfThread(self.operator, namespaces, self._wake) if namespaces else None
        self._kopf_heartbeat = Heartbeat(self._kopf.submit) if self._kopf else None

    def _connect(self) -> None:
        """On a thread: waiting for a router must not keep the operator from its other work."""
        session = open_client(self._settings.connect, self._stop, self._settings.credentials)
        if session is not None:
            self.operator.connected(session)

    def _close(self) -> None:
        """Kopf first, so that no handler runs; the Lease last, when nothing of ours is on its way any more."""
        self._stop.set()
        if self._kopf is not None:
            self._kopf.stop()
        self._connecting.join()
        self._watches.stop()
        self.operator.close()
        self._leadership.stop()
        self._api.close()

    def _ended(self) -> Iterable[str]:
        yield from self._watches.check()
        try:
            self._leadership.check()
        except RuntimeError as error:
            yield str(error)

    def _late(self) -> Iterable[str]:
        for name, heartbeat in (("the loop", self._heartbeat), ("kopf's loop", self._kopf_heartbeat)):
            delay = heartbeat.delay() if heartbeat else 0.0
            if delay > HUNG:
                yield f"{name} has not answered for {delay:.1f} s"

    def _await(self, stop: Event) -> None:
        stop.wait()
        self._wake()

    def _wake(self) -> None:
        with self._news:
            self._woken = True
            self._news.notify()

    def _sleep(self) -> None:
        """Until something has happened since this was last called."""
        with self._news:
            self._news.wait_for(lambda: self._woken)
            self._woken = False


def restart_process() -> NoReturn:
    """Begin as a new process with our process id: no thread survives, and no kubelet delays the start."""
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 - our own command line again


def _pauses() -> Iterable[float]:
    yield from PAUSES
    while True:
        yield PAUSES[-1]
