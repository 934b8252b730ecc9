"""The operator's process: gets ready, stands by until it leads, then runs kopf for the namespaces that are its own.

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
from contextpolicy.app.wiring import Operator
from contextpolicy.bus.session import open_client
from contextpolicy.bus.signatures import Signer
from contextpolicy.cluster.api import ApiServer
from contextpolicy.cluster.watching import ObjectWatch
from contextpolicy.errors import ActuationError
from contextpolicy.streams.loop import Loop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from typing import Any

    from contextpolicy.app.settings import Settings

log = logging.getLogger(__name__)

PATCH_WORKERS = 8
"""Concurrent patches: enough for one robot's tasks; more would only queue in the API server."""
PAUSES = (0.1, 0.2, 0.5, 1.0)
"""Seconds between attempts to find the API server at the start; the last one repeats."""
NOT_INSTALLED = "the custom resource is not installed: kubectl apply -f crds/"
CLOSED = (
    "namespace %s is not served: its pods may not be listed. Upgrade the release if its Role is missing. If the "
    "namespace is being deleted, the Role is gone already, and policies that are left there hold it up: let them go "
    "with `contextpolicy restore --namespace %s --remove-finalizers`"
)
POLICIES = "/apis/contextpolicy.dev/v1alpha1/contextpolicies"


def reach(stop: Event) -> ApiServer | None:
    """The API server, as soon as it answers and has the custom resource; None when `stop` is set first."""
    told = ""
    for pause in _pauses():
        try:
            api = ApiServer()
            problem = "" if api.serves_policies() else NOT_INSTALLED
        except ActuationError as error:
            if not error.retriable and error.reason == "NoCluster":
                raise
            problem = str(error)
        if not problem:
            return api
        if problem != told:
            log.warning("not started yet: %s", problem)
            told = problem
        if stop.wait(pause):
            break
    return None


class Supervisor:
    """One replica from start to end; `restart` begins anew with nothing kept, and does not return."""

    def __init__(self, api: ApiServer, settings: Settings, restart: Callable[[], NoReturn]) -> None:
        self._api, self._settings, self._restart = api, settings, restart
        self._leadership = Leadership(api, settings)
        self._leadership.on_news = self._wake
        api.may_act = self._leadership.may_act
        patches = ThreadPoolExecutor(PATCH_WORKERS, thread_name_prefix="patch")
        reports = ThreadPoolExecutor(1, thread_name_prefix="report")
        signer = Signer(settings.signing) if settings.signing else None
        loop = Loop()
        self.runtime = Operator(api, loop, patches=patches, reports=reports, signer=signer, tenants=settings.tenants)
        self._pulse = Heartbeat(lambda beat: loop.schedule(lambda *_: beat()))
        self._homes: dict[str, str] = {}
        """Namespace of each policy by UID, where all namespaces are served."""
        self._watches = _watches(api, settings.namespaces, self.runtime)
        self._pod_lists = {pods_of(namespace): namespace for namespace in settings.namespaces}
        self._refused: frozenset[str] = frozenset()
        if not settings.namespaces:
            self._watches.append(ObjectWatch(api, POLICIES, self._on_policy, self._on_policy_gone))
        self._news, self._woken = Condition(), False
        self._kopf: KopfThread | None = None
        self._kopf_pulse: Heartbeat | None = None
        self._interruptions = 0
        self._stop = Event()
        self._connecting = Thread(target=self._connect, name="connect", daemon=True)

    def run(self, stop: Event) -> int:
        """Run until `stop` is set, then give the Lease back; the exit code."""
        for watch in self._watches:
            watch.listed.add_done_callback(lambda _: self._wake())
            watch.on_refused = self._wake
            watch.start()
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
        unlisted = [str(watch) for watch in self._watches if self._is_unlisted(watch)]
        problems = [f"not listed yet: {', '.join(unlisted)}"] if unlisted else []
        if not self.runtime.has_router:
            problems.append("no Zenoh router answers")
        if not (self._leadership.leads or self._leadership.follows):
            problems.append("the Lease is not ours, and nobody was seen to renew it")
        return [*problems, *self.hung()]

    def _follow_leadership(self) -> None:
        """Run kopf for what is ours, once all pods and nodes are known.

        Before that, a policy being deleted would seem to have no containers left, and would lose its finalizer.
        """
        if self._leadership.deposed:
            log.warning("another replica leads: starting anew as its standby")
            self._restart()
        if not self._leadership.leads or any(self._is_unlisted(watch) for watch in self._watches):
            return
        self._leadership.serve((set(self._settings.namespaces) or set(self._homes.values())) - self._closed_to_us())
        served = self._leadership.served
        if served is not None and served != (self._kopf.namespaces if self._kopf else frozenset()):
            self._serve(served)
        if self._leadership.interruptions != self._interruptions:
            self._interruptions = self._leadership.interruptions
            self.runtime.resume()

    def _is_unlisted(self, watch: ObjectWatch) -> bool:
        """A namespace of several that lets us see no pods must not keep us from the others."""
        return not watch.listed.done() and not (watch.refused and str(watch) in self._pod_lists)

    def _closed_to_us(self) -> set[str]:
        """The namespaces whose pods we may not see: their roles are missing, or went with the namespace."""
        refused = frozenset(
            self._pod_lists[str(watch)] for watch in self._watches if watch.refused and str(watch) in self._pod_lists
        )
        for namespace in sorted(refused - self._refused):
            log.warning(CLOSED, namespace, namespace)
        self._refused = refused
        return set(refused)

    def _serve(self, namespaces: frozenset[str]) -> None:
        log.info("serving %s", ", ".join(sorted(namespaces)) or "no namespace")
        if self._kopf is not None:
            self._kopf.stop()
            for lost in self._kopf.namespaces - namespaces:
                self.runtime.abandon(lost)
        self._kopf = KopfThread(self.runtime, namespaces, self._wake) if namespaces else None
        self._kopf_pulse = Heartbeat(self._kopf.submit) if self._kopf else None

    def _connect(self) -> None:
        """On a thread: waiting for a router must not keep the operator from its other work."""
        session = open_client(self._settings.connect, self._stop, self._settings.credentials)
        if session is not None:
            self.runtime.connected(session)

    def _close(self) -> None:
        """Kopf first, so that no handler runs; the Lease last, when nothing of ours is on its way any more."""
        self._stop.set()
        if self._kopf is not None:
            self._kopf.stop()
        self._connecting.join()
        for watch in self._watches:
            watch.stop()
        self.runtime.close()
        self._leadership.stop()
        self._api.close()

    def _ended(self) -> Iterable[str]:
        parts: tuple[ObjectWatch | Leadership, ...] = (*self._watches, self._leadership)
        for part in parts:
            try:
                part.check()
            except RuntimeError as error:
                yield str(error)

    def _late(self) -> Iterable[str]:
        for name, pulse in (("the loop", self._pulse), ("kopf's loop", self._kopf_pulse)):
            delay = pulse.delay() if pulse else 0.0
            if delay > HUNG:
                yield f"{name} has not answered for {delay:.1f} s"

    def _on_policy(self, policy: Mapping[str, Any]) -> None:
        self._homes[policy["metadata"]["uid"]] = policy["metadata"]["namespace"]
        self._wake()

    def _on_policy_gone(self, uid: str) -> None:
        self._homes.pop(uid, None)
        self._wake()

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


def start_anew() -> NoReturn:
    """Begin as a new process with our process id: no thread survives, and no kubelet delays the start."""
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 - our own command line again


def _watches(api: ApiServer, namespaces: Iterable[str], runtime: Operator) -> list[ObjectWatch]:
    """Watches for pods and nodes. Nodes that are deleted need no handling: their pods are deleted too."""
    lists = [pods_of(namespace) for namespace in namespaces] or ["/api/v1/pods"]
    pods = [ObjectWatch(api, path, runtime.pod_changed, runtime.pod_gone) for path in lists]
    return [*pods, ObjectWatch(api, "/api/v1/nodes", runtime.node_changed, lambda _: None)]


def pods_of(namespace: str) -> str:
    """The list of a namespace's pods."""
    return f"/api/v1/namespaces/{namespace}/pods"


def _pauses() -> Iterable[float]:
    yield from PAUSES
    while True:
        yield PAUSES[-1]
