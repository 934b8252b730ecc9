"""Kopf only: the life of ContextPolicy objects, and the watches of pods and nodes. Parse, call, return."""

from __future__ import annotations

import asyncio
from threading import Event
from typing import TYPE_CHECKING, Any

import kopf

from contextpolicy.cluster.api import FINALIZER, Api
from contextpolicy.runtime import Runtime
from contextpolicy.streams.loop import Loop
from contextpolicy.streams.zenoh_session import open_client

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.settings import Settings

PLURAL, GROUP = "contextpolicies", "contextpolicy.dev"
registry = kopf.get_default_registry()
"""Where the decorators below put the handlers."""

RECONNECT = (0.1, 0.2, 0.5, *[1.0] * 60)
"""Seconds between attempts to reach the API server: kopf's own pauses grow to 21 s, a robot reboots faster."""
RESTORE_TIMEOUT = 20.0
"""Seconds to wait for a restore before kopf tries again; the finalizer keeps the object until it is done."""


@kopf.on.startup()
async def start(settings: kopf.OperatorSettings, memo: Any, **_: Any) -> None:
    """Open everything that is opened once."""
    settings.persistence.finalizer = FINALIZER
    settings.persistence.progress_storage = kopf.AnnotationsProgressStorage(prefix=GROUP)
    settings.persistence.diffbase_storage = kopf.AnnotationsDiffBaseStorage(prefix=GROUP)
    settings.posting.enabled = False
    settings.scanning.disabled = True
    settings.networking.error_backoffs = RECONNECT
    own: Settings = memo.settings
    api = Api()
    if not await asyncio.to_thread(api.serves_policies):
        raise kopf.PermanentError("the custom resource is not installed: kubectl apply -f crds/, then start again")
    memo.runtime, memo.stop = Runtime(api, Loop()), Event()
    memo.connecting = asyncio.create_task(asyncio.to_thread(_connect, own.connect, memo.runtime, memo.stop))


def _connect(endpoints: tuple[str, ...], runtime: Runtime, stop: Event) -> None:
    """On a thread: a router that is not there yet must not keep the operator from its other work."""
    session = open_client(endpoints, stop)
    if session is not None:
        runtime.connected(session)


@kopf.on.cleanup()
async def stop(memo: Any, **_: Any) -> None:
    """Close it again."""
    memo.stop.set()
    await memo.connecting
    await asyncio.to_thread(memo.runtime.close)


@kopf.on.resume(GROUP, PLURAL)
@kopf.on.create(GROUP, PLURAL)
@kopf.on.update(GROUP, PLURAL)
async def apply(body: kopf.Body, memo: Any, **_: Any) -> None:
    """A policy exists, is new or was edited."""
    await asyncio.wrap_future(memo.runtime.policy_changed(dict(body)))


@kopf.on.delete(GROUP, PLURAL)
async def release(namespace: str | None, name: str, memo: Any, **_: Any) -> None:
    """Put every container back before the policy may go."""
    restored = memo.runtime.policy_deleted(namespace or "", name)
    try:
        await asyncio.wait_for(asyncio.wrap_future(restored), RESTORE_TIMEOUT)
    except TimeoutError:
        raise kopf.TemporaryError("containers are not restored yet", delay=1) from None


# Kopf calls no handler before it has listed everything that has an index. What calls these is not the indices, which
# stay empty, but their promise: a policy is deleted, or planned for, when all pods and nodes are known, not before.


@kopf.index("pods")
async def pod(body: Mapping[str, Any], memo: Any, **_: Any) -> None:
    """A pod appeared or changed; async, because a thread of kopf's pool would only add a hop."""
    memo.runtime.pod_changed(body)


@kopf.on.event("pods")
async def pod_gone(type: str | None, body: Mapping[str, Any], memo: Any, **_: Any) -> None:  # noqa: A002 - kopf's name
    """A pod went."""
    if type == "DELETED":
        memo.runtime.pod_gone(body["metadata"]["uid"])


@kopf.index("nodes")
async def node(body: Mapping[str, Any], memo: Any, **_: Any) -> None:
    """A node appeared or changed; one that went has no pods any more."""
    memo.runtime.node_changed(body)


@kopf.on.probe(id="loop")
def healthy(memo: Any, **_: Any) -> float:
    """The loop's delay in seconds: a loop that hangs fails the liveness probe by time-out."""
    return float(memo.runtime.delay())
