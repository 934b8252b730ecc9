"""Kopf handlers only: the life cycle of ContextPolicy objects. Parse, call, return.

They run in the replica that leads, for the namespaces that are its own: kopf itself changes finalizers and annotations.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
from contextlib import suppress
from datetime import datetime
from typing import TYPE_CHECKING, Any

import kopf

from contextpolicy.policy.custom_resource import FINALIZER, GROUP, PLURAL

if TYPE_CHECKING:
    from collections.abc import Mapping

registry = kopf.get_default_registry()
"""Where the decorators below register the handlers."""

RECONNECT = (0.1, 0.2, 0.5, *[1.0] * 60)
"""Seconds between attempts to reach the API server: kopf's own pauses grow to 21 s, but a robot reboots faster."""
EXIT_TIMEOUT = 0.3
"""Seconds that a running handler may take when the operator ends: a standby waits for our Lease, and reruns it."""
RESTORE_TIMEOUT = 20.0
"""Seconds to wait for a restore before kopf tries again; the finalizer keeps the object until it is done."""

REREAD = 10.0
"""Seconds until kopf retries a policy whose ConfigMap can't be read: GitOps may create that later."""


class Digests(kopf.AnnotationsDiffBaseStorage):
    """Recognises an edit by a digest of what kopf compares, which it otherwise stores whole in an annotation.

    Kubernetes refuses more than 256 KiB of annotations: a policy of that size, or with notes of half of it, was never
    taken up and could not be deleted. The digest is of the UID too: who exports a policy and applies it again, maybe
    under another name, copies the annotation, and nothing would seem new.
    """

    def build(self, *, body: kopf.Body, extra_fields: Any = None) -> kopf.BodyEssence:
        """The digest in the essence's place: our handlers need to know that something differs, not what."""
        essence = super().build(body=body, extra_fields=extra_fields)
        text = json.dumps([body.metadata.uid, essence], sort_keys=True, separators=(",", ":"))
        return kopf.BodyEssence(spec={"digest": hashlib.sha256(text.encode()).hexdigest()})

    def fetch(self, *, body: kopf.Body) -> kopf.BodyEssence | None:
        """None where the annotation is not kopf's: kopf would fail on it, and never serve the policy again."""
        with suppress(ValueError, RecursionError):
            found = super().fetch(body=body)
            return found if isinstance(found, dict) else None
        return None


class Progress(kopf.AnnotationsProgressStorage):
    """What kopf has begun with a policy: in annotations, which anyone who may edit the policy can write."""

    def fetch(self, *, key: Any, body: kopf.Body) -> Any:
        """None where the annotation is not kopf's."""
        with suppress(ValueError, TypeError, AttributeError, RecursionError):
            found = super().fetch(key=key, body=body)
            return found if found is None or _is_progress(found) else None
        return None


def _is_progress(found: Mapping[str, Any]) -> bool:
    """Whether kopf can go on with it; ValueError, TypeError and AttributeError mean that it can't."""
    for moment in filter(None, map(found.get, ("started", "stopped", "delayed"))):
        datetime.fromisoformat(moment)
    texts = [*(found.get("subrefs") or ()), found.get("purpose") or "", found.get("message") or ""]
    return isinstance(found.get("retries", 0), int) and all(isinstance(text, str) for text in texts)


@kopf.on.startup()
async def configure(settings: kopf.OperatorSettings, memo: Any, **_: Any) -> None:
    """Set kopf up. Nothing here may fail: kopf would try again after a minute."""
    settings.persistence.finalizer = FINALIZER
    settings.persistence.progress_storage = Progress(prefix=GROUP)
    settings.persistence.diffbase_storage = Digests(prefix=GROUP)
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
        raise kopf.TemporaryError("something that the policy refers to can't be read yet", delay=REREAD)


@kopf.on.event(GROUP, PLURAL)
async def see(type: str | None, body: kopf.Body, memo: Any, **_: Any) -> None:  # noqa: A002 - kopf's name for it
    """Anything of a policy has changed, its status too, or it is gone: kopf calls this after the handlers begun before.

    The watch of policies may report an end while `apply` still reads what the policy names.
    """
    if type == "DELETED":
        memo.operator.policy_gone(body.metadata.uid)
    else:
        memo.operator.policy_seen(dict(body))


@kopf.on.delete(GROUP, PLURAL)
async def release(body: kopf.Body, memo: Any, **_: Any) -> None:
    """Restore every container before the finalizer is removed."""
    restored = await asyncio.to_thread(memo.operator.policy_deleted, dict(body))
    try:
        await asyncio.wait_for(asyncio.wrap_future(restored), RESTORE_TIMEOUT)
    except TimeoutError:
        raise kopf.TemporaryError("containers are not restored yet", delay=1) from None
