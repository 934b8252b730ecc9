"""Kopf handlers only: startup, shutdown, and the life cycle of ContextPolicy objects. Parse, call, return."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import TYPE_CHECKING, Any

import kopf
from prometheus_client import REGISTRY

from contextpolicy.bus.session import open_client
from contextpolicy.bus.signatures import Signer
from contextpolicy.cluster.api import FINALIZER, ApiServer
from contextpolicy.cluster.watching import ObjectWatch
from contextpolicy.live.page_server import PageServer
from contextpolicy.loop import Loop
from contextpolicy.runtime import Runtime
from contextpolicy.telemetry import metrics
from contextpolicy.telemetry.scrape import Scrape

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.settings import Settings

PLURAL, GROUP = "contextpolicies", "contextpolicy.dev"
registry = kopf.get_default_registry()
"""Where the decorators below register the handlers."""

RECONNECT = (0.1, 0.2, 0.5, *[1.0] * 60)
"""Seconds between attempts to reach the API server: kopf's own pauses grow to 21 s, but a robot reboots faster."""
PATCH_WORKERS = 8
"""Concurrent patches: enough for one robot's tasks; more would only queue in the API server."""
RESTORE_TIMEOUT = 20.0
"""Seconds to wait for a restore before kopf tries again; the finalizer keeps the object until it is done."""

REREAD = 10.0
"""Seconds until kopf retries a policy whose ConfigMap can't be read: GitOps may create that later."""


@kopf.on.startup()
async def start(settings: kopf.OperatorSettings, memo: Any, **_: Any) -> None:
    """Open everything that lives as long as the operator."""
    settings.persistence.finalizer = FINALIZER
    settings.persistence.progress_storage = kopf.AnnotationsProgressStorage(prefix=GROUP)
    settings.persistence.diffbase_storage = kopf.AnnotationsDiffBaseStorage(prefix=GROUP)
    settings.posting.enabled = False
    settings.scanning.disabled = True
    settings.networking.error_backoffs = RECONNECT
    own: Settings = memo.settings
    api = ApiServer()
    api.on_answer = lambda method, code: metrics.API_REQUESTS.labels(method, code).inc()
    if not await asyncio.to_thread(api.serves_policies):
        raise kopf.PermanentError("the custom resource is not installed: kubectl apply -f crds/, then start again")
    patches = ThreadPoolExecutor(PATCH_WORKERS, thread_name_prefix="patch")
    reports = ThreadPoolExecutor(1, thread_name_prefix="report")
    signer = Signer(own.signing) if own.signing else None
    memo.stop = Event()
    memo.runtime = Runtime(api, Loop(), patches=patches, reports=reports, signer=signer, tenants=own.tenants)
    memo.scrape = Scrape(memo.runtime.scrape)
    REGISTRY.register(memo.scrape)
    memo.live = PageServer(own.live_port, memo.runtime)
    memo.live.start()
    memo.watches = _watches(api, own.namespaces, memo.runtime)
    for watch in memo.watches:
        watch.start()
    # Before pods are listed, a policy being deleted would seem to have no containers left to restore and lose its
    # finalizer. Kopf calls no other handler until startup is done.
    await asyncio.gather(*(asyncio.wrap_future(watch.listed) for watch in memo.watches))
    memo.connecting = asyncio.create_task(asyncio.to_thread(_connect, own, memo.runtime, memo.stop))


def _watches(api: ApiServer, namespaces: Sequence[str], runtime: Runtime) -> list[ObjectWatch]:
    """Watches for pods and nodes. Nodes that are deleted need no handling: their pods are deleted too."""
    lists = [f"/api/v1/namespaces/{namespace}/pods" for namespace in namespaces] or ["/api/v1/pods"]
    pods = [ObjectWatch(api, path, runtime.pod_changed, runtime.pod_gone) for path in lists]
    return [*pods, ObjectWatch(api, "/api/v1/nodes", runtime.node_changed, lambda _: None)]


def _connect(settings: Settings, runtime: Runtime, stop: Event) -> None:
    """Run on a thread: waiting for a router must not keep the operator from its other work."""
    session = open_client(settings.connect, stop, settings.credentials)
    if session is not None:
        runtime.connected(session)


@kopf.on.cleanup()
async def stop(memo: Any, **_: Any) -> None:
    """Close everything; limits stay in force."""
    memo.stop.set()
    await memo.connecting
    REGISTRY.unregister(memo.scrape)
    await asyncio.to_thread(memo.live.close)
    await asyncio.to_thread(_close, memo.watches, memo.runtime)


def _close(watches: Sequence[ObjectWatch], runtime: Runtime) -> None:
    for watch in watches:
        watch.stop()
    runtime.close()


@kopf.on.resume(GROUP, PLURAL)
@kopf.on.create(GROUP, PLURAL)
@kopf.on.update(GROUP, PLURAL)
async def apply(body: kopf.Body, memo: Any, **_: Any) -> None:
    """A policy exists at startup, is new or was edited."""
    adopted = await asyncio.to_thread(memo.runtime.policy_changed, dict(body))
    if not await asyncio.wrap_future(adopted):
        raise kopf.TemporaryError("not all that the policy names can be read", delay=REREAD)


@kopf.on.delete(GROUP, PLURAL)
async def release(body: kopf.Body, memo: Any, **_: Any) -> None:
    """Restore every container before the finalizer is removed."""
    restored = memo.runtime.policy_deleted(dict(body))
    try:
        await asyncio.wait_for(asyncio.wrap_future(restored), RESTORE_TIMEOUT)
    except TimeoutError:
        raise kopf.TemporaryError("containers are not restored yet", delay=1) from None


@kopf.on.probe(id="loop")
def healthy(memo: Any, **_: Any) -> float:
    """The loop's delay in seconds; raises when the loop hangs or a watch has ended, which fails the liveness probe."""
    for watch in memo.watches:
        watch.check()
    return float(memo.runtime.delay())
