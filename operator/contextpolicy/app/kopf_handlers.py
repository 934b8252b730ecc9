"""Kopf handlers only: the life cycle of ContextPolicy objects. Parse, call, return.

They run in the replica that leads, for the namespaces that are its own: kopf itself changes finalizers and annotations.
"""

from __future__ import annotations

import asyncio
from typing import Any

import kopf

from contextpolicy.cluster.api import FINALIZER

PLURAL, GROUP = "contextpolicies", "contextpolicy.dev"
registry = kopf.get_default_registry()
"""Where the decorators below register the handlers."""

RECONNECT = (0.1, 0.2, 0.5, *[1.0] * 60)
"""Seconds between attempts to reach the API server: kopf's own pauses grow to 21 s, but a robot reboots faster."""
EXIT_TIMEOUT = 0.3
"""Seconds that a handler under way may take when the operator ends: a standby waits for our Lease, and does it anew."""
RESTORE_TIMEOUT = 20.0
"""Seconds to wait for a restore before kopf tries again; the finalizer keeps the object until it is done."""

REREAD = 10.0
"""Seconds until kopf retries a policy whose ConfigMap can't be read: GitOps may create that later."""


@kopf.on.startup()
async def configure(settings: kopf.OperatorSettings, memo: Any, **_: Any) -> None:
    """Set kopf up. Nothing here may fail: kopf would try again after a minute."""
    settings.persistence.finalizer = FINALIZER
    settings.persistence.progress_storage = kopf.AnnotationsProgressStorage(prefix=GROUP)
    settings.persistence.diffbase_storage = kopf.AnnotationsDiffBaseStorage(prefix=GROUP)
    settings.posting.enabled = False
    settings.scanning.disabled = True
    settings.networking.error_backoffs = RECONNECT
    settings.queueing.exit_timeout = EXIT_TIMEOUT
    memo.loop = asyncio.get_running_loop()


@kopf.on.resume(GROUP, PLURAL)
@kopf.on.create(GROUP, PLURAL)
@kopf.on.update(GROUP, PLURAL)
async def apply(body: kopf.Body, memo: Any, **_: Any) -> None:
    """A policy exists at startup, is new or was edited."""
    adopted = await asyncio.to_thread(memo.operator.policy_changed, dict(body))
    if not await asyncio.wrap_future(adopted):
        raise kopf.TemporaryError("not all that the policy names can be read", delay=REREAD)


@kopf.on.delete(GROUP, PLURAL)
async def release(body: kopf.Body, memo: Any, **_: Any) -> None:
    """Restore every container before the finalizer is removed."""
    restored = memo.operator.policy_deleted(dict(body))
    try:
        await asyncio.wait_for(asyncio.wrap_future(restored), RESTORE_TIMEOUT)
    except TimeoutError:
        raise kopf.TemporaryError("containers are not restored yet", delay=1) from None
