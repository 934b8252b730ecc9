"""One replica of the operator: gets ready, stands by until it leads, then runs kopf for the namespaces that it serves.

A standby knows all pods and nodes and has the bus already, so that it decides as soon as it leads; it changes nothing.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Condition, Event, Thread
from typing import TYPE_CHECKING, NoReturn, Protocol

from contextpolicy.app.kopf_threads import KopfThreads
from contextpolicy.app.leadership import Leadership
from contextpolicy.app.probes import HUNG, Heartbeat
from contextpolicy.app.watches import Watches
from contextpolicy.app.wiring import Operator
from contextpolicy.bus.session import open_client
from contextpolicy.bus.signatures import Signer, UnsignedPlans
from contextpolicy.cluster.api import ApiServer
from contextpolicy.errors import ActuationError
from contextpolicy.streams.loop import Loop, on_loop
from contextpolicy.streams.wall_clock import WallClock

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from contextpolicy.actuators.resize.stored_originals import EntrySignatures
    from contextpolicy.app.settings import Settings
    from contextpolicy.cluster.api_connection import AnswerListener

log = logging.getLogger(__name__)

PATCH_WORKERS = 8
"""Concurrent patches: enough for one robot's tasks; more would only queue in the API server."""
PAUSES = (0.1, 0.2, 0.5, 1.0)
"""Seconds between attempts to find the API server at the start; the last one repeats."""
NOT_INSTALLED = "the custom resource is not installed: kubectl apply -f crds/"


def reach(stop: Event, listener: AnswerListener) -> ApiServer | None:
    """The API server, as soon as it answers and has the custom resource; None when `stop` is set first."""
    reported = ""
    for pause in _pauses():
        try:
            api = ApiServer(listener)
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


class ReplicaListener(Protocol):
    """Receives the end of a replica's leadership."""

    def on_deposed(self) -> NoReturn:
        """Another replica leads: restart as its standby, without any state."""


class Supervisor:
    """One replica from start to end."""

    def __init__(
        self, api: ApiServer, settings: Settings, listener: ReplicaListener, signatures: EntrySignatures
    ) -> None:
        self._api, self._settings, self._listener = api, settings, listener
        self._news, self._woken = Condition(), False
        self._leadership = Leadership(api, settings, self)
        loop = Loop()
        self.operator = Operator(
            api,
            self._leadership,
            loop,
            patches=ThreadPoolExecutor(PATCH_WORKERS, thread_name_prefix="patch"),
            reports=ThreadPoolExecutor(1, thread_name_prefix="report"),
            signer=Signer(settings.signing) if settings.signing else UnsignedPlans(),
            signatures=signatures,
            tenants=settings.tenants,
            clock=WallClock(loop),
            agents_everywhere=settings.agents_everywhere,
            settled=settings.settle_seconds,
        )
        self._heartbeat = Heartbeat(_LoopThread(loop))
        self._watches = Watches(api, settings.namespaces, self.operator, self, time.monotonic)
        self._kopf = KopfThreads(self.operator, self)
        self._kopf_heartbeat = Heartbeat(self._kopf)
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
            while not (stop.is_set() or self._kopf.failed):
                self._follow_leadership()
                self._sleep()
            return 1 if self._kopf.failed else 0
        finally:
            self._close()

    def hung(self) -> list[str]:
        """The parts of the process that hang; nothing else justifies a restart."""
        return [*self._ended(), *self._late()]

    def delays(self) -> Mapping[str, float]:
        """Seconds for which each loop has not answered, by its name; takes at most a second, whatever hangs."""
        beating = {"the event loop": self._heartbeat, "kopf's loops": self._kopf_heartbeat}
        return {name: heartbeat.delay() for name, heartbeat in beating.items()}

    def unready(self) -> list[str]:
        """Why this replica does not decide, or could not as soon as it leads."""
        unlisted = self._watches.unlisted()
        problems = [f"not listed yet: {', '.join(unlisted)}"] if unlisted else []
        if not self.operator.has_router:
            problems.append("no Zenoh router answers")
        if not (self._leadership.leads or self._leadership.follows):
            problems.append("this replica does not hold the Lease and has seen no other renew it")
        return [*problems, *self.hung()]

    def on_lease(self) -> None:
        """The Leases that this replica holds may have changed."""
        self._wake()

    def on_lists(self) -> None:
        """The namespaces to serve may have changed."""
        self._wake()

    def on_kopf_end(self) -> None:
        """Kopf has failed, and this process with it."""
        self._wake()

    def _follow_leadership(self) -> None:
        """Run kopf for what is ours, once all pods and nodes are known.

        Before that, a policy being deleted would seem to have no containers left, and would lose its finalizer.
        """
        if self._leadership.deposed:
            log.warning("another replica leads: restarting as its standby")
            self._listener.on_deposed()
        if not self._leadership.leads or self._watches.unlisted():
            return
        self._leadership.serve(self._watches.served(self._kopf.namespaces))
        served = self._leadership.served
        if served is not None and served != self._kopf.namespaces:
            self._serve(served)
        if self._leadership.interruptions != self._interruptions:
            self._interruptions = self._leadership.interruptions
            self.operator.resume()

    def _serve(self, namespaces: frozenset[str]) -> None:
        log.info("serving %s", ", ".join(sorted(namespaces)) or "no namespace")
        before = self._kopf.namespaces
        self._kopf.serve(namespaces)
        # A beat may have ended with a thread.
        self._kopf_heartbeat = Heartbeat(self._kopf)
        for lost in before - namespaces:
            self.operator.abandon(lost)

    def _connect(self) -> None:
        """On a thread: waiting for a router must not keep the operator from its other work."""
        session = open_client(self._settings.connect, self._stop, self._settings.credentials)
        if session is not None:
            self.operator.connected(session)

    def _close(self) -> None:
        """Kopf first, so that no handler runs; the Lease last, when nothing of ours is on its way any more."""
        self._stop.set()
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
        for name, delay in self.delays().items():
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
        """Until something has happened since this was last called, or time has changed what is to be served."""
        with self._news:
            self._news.wait_for(lambda: self._woken, self._watches.next_change())
            self._woken = False


class NewProcess:
    """A deposed replica begins as a new process with our process id: no thread survives, and no kubelet delays it."""

    def on_deposed(self) -> NoReturn:
        """Begin it."""
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 - our own command line again


class _LoopThread:
    """The loop, as what has a heartbeat."""

    def __init__(self, loop: Loop) -> None:
        self._loop = loop

    def submit(self, beat: Callable[[], None]) -> object:
        return on_loop(self._loop, beat)


def _pauses() -> Iterable[float]:
    yield from PAUSES
    while True:
        yield PAUSES[-1]
