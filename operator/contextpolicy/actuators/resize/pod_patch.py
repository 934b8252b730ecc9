"""Send one patch to a pod, or read the pod to learn how a patch ended; both run on a worker's thread."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize.patches import resize_patch
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.writers import FIELD_MANAGER, RESTORE_MANAGER
from contextpolicy.errors import ActuationError, unexpected

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.pods import Cpu, PodView

log = logging.getLogger(__name__)


class ResizeApi(Protocol):
    """What the resizer needs of the API server."""

    def resize(self, namespace: str, pod: str, patch: Mapping[str, object], manager: str) -> int:
        """PATCH pods/resize as this field manager; returns the resourceVersion of the changed pod."""

    def pod(self, namespace: str, name: str) -> dict[str, Any]:
        """GET a pod."""

    def write_originals(self, namespace: str, policy: str, changes: Mapping[str, object]) -> int:
        """Merge into `status.originals` of a policy; None removes an entry. Returns the policy's resourceVersion."""


@dataclass(frozen=True, slots=True)
class Patch:
    """The resources to set in one pod for one policy: towards its plan, or (`restore`) back to the originals."""

    policy: str
    resources: Mapping[str, Cpu]
    restore: bool = False


@dataclass(frozen=True, slots=True)
class Answer:
    """How a patch ended: `version` is the changed pod's resourceVersion, `received` the answer's monotonic time.

    With an `error`, neither is set.
    """

    version: int = 0
    received: float = 0.0
    error: ActuationError | None = None


def send(api: ResizeApi, pod: PodView, patch: Patch) -> Answer:
    """Send a patch. Any exception becomes an answer: if the worker raised, the pod would wait for ever."""
    manager = RESTORE_MANAGER if patch.restore else FIELD_MANAGER
    try:
        version = api.resize(pod.namespace, pod.name, resize_patch(pod, patch.resources), manager)
    except ActuationError as error:
        return Answer(error=_replaced(pod) if _is_of_another(error) else error)
    except Exception as error:
        log.exception("the resize of pod %s/%s failed", pod.namespace, pod.name)
        return Answer(error=unexpected(error))
    return Answer(version, time.monotonic())


@dataclass(frozen=True, slots=True)
class Found:
    """A pod as the API server had it at the monotonic time `received`."""

    view: PodView
    received: float


def ask(api: ResizeApi, pod: PodView) -> Found | ActuationError:
    """The pod as the API server has it now; NotFound also when a new pod has the same name."""
    try:
        found = view(api.pod(pod.namespace, pod.name))
    except ActuationError as error:
        return error
    except Exception as error:
        log.exception("pod %s/%s can't be read", pod.namespace, pod.name)
        return unexpected(error)
    return Found(found, time.monotonic()) if found.uid == pod.uid else _replaced(pod)


def _is_of_another(error: ActuationError) -> bool:
    """The server lets no patch change a UID: `metadata.uid: Invalid value: ...: field is immutable`."""
    return error.reason == "Invalid" and "metadata.uid" in str(error)


def _replaced(pod: PodView) -> ActuationError:
    return ActuationError("NotFound", f"pod {pod.name} was replaced by another one", retriable=False)
