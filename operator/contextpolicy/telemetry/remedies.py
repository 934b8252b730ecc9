"""What a user can do about a resize that was refused, held back or reverted. Pure."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.pauses import REFUSED
from contextpolicy.cluster.writers import FIELD_MANAGER

if TYPE_CHECKING:
    from contextpolicy.errors import ActuationError

_AGAIN = f"the operator retries within {REFUSED.longest:.0f} s"
_BOUNDED = (
    "the pod has resources of its own (spec.resources), which bound those of its containers: set the task's max to the "
    "pod's CPU limit and enforcement.control to Limit, or remove them from the pod template"
)
_REFUSALS = (
    (r"exceeded quota", f"raise the ResourceQuota or lower the task's max; {_AGAIN}"),
    (
        r"usage per (Container|Pod) is|limit to request ratio per",
        f"widen the LimitRange or lower the task's max; {_AGAIN}",
    ),
    (r"pod limits of|aggregate container requests", f"{_BOUNDED}; {_AGAIN}"),
    (r"enough allocatable resources", f"raise the policy's reserve or lower the task's max; {_AGAIN}"),
    (r"cannot (patch|update) resource", f"allow the operator's role to patch pods/resize; {_AGAIN}"),
    (r"denied (the )?request", f"allow the operator's resizes in that admission policy or webhook; {_AGAIN}"),
)
_NO_ROOM = (
    "its CPU request does not fit on the node: raise the policy's reserve, lower the requests of its pods or the "
    "task's max, or, unless control is Weight, give the pod unequal memory request and limit, so that only its CPU "
    "limit changes; the kubelet carries out the resize when there is room"
)
_STATIC_CPUS = (
    "a static CPU manager can't resize Guaranteed pods: give it unequal memory request and limit, so that it is "
    "Burstable, or leave it out of the policy"
)
_PENDING = (
    (r"^Deferred", _NO_ROOM),
    (r"^Infeasible.*CPU Manager", _STATIC_CPUS),
    (r"^Infeasible", "this node can't resize the pod to that: lower the task's max, or run the pod elsewhere"),
    (r"^Error", "the kubelet retries by itself; its log has the reason"),
)
_WRITERS = (
    (
        r"vpa|^updater$|vertical-pod",
        'set updateMode: "Off" in its VerticalPodAutoscaler, or controlledResources: [memory] for this container',
    ),
    (r"startup-cpu-boost", "exclude this pod from its StartupCPUBoost"),
    (
        rf"^({FIELD_MANAGER})?$",
        (
            "an admission webhook changes what the operator asks for, or a second operator runs: exempt pods/resize "
            "from the webhook, or stop the second operator"
        ),
    ),
    (r"^kubectl", "change the policy instead: the task's min, max or priority, or mode: Paused"),
)
_ONE_DECIDES = "let only one of them set its CPU: exclude the container there, or leave it out of the policy"


def for_refusal(error: ActuationError) -> str:
    """What to do about a refused patch; empty when its message already says it all."""
    return next((remedy for pattern, remedy in _REFUSALS if re.search(pattern, str(error))), "")


def for_pending(pending: str) -> str:
    """What to do about a resize that the kubelet holds back."""
    return next((remedy for pattern, remedy in _PENDING if re.search(pattern, pending)), "")


def for_writer(manager: str) -> str:
    """What to do about another writer that resizes a container."""
    return next((remedy for pattern, remedy in _WRITERS if re.search(pattern, manager)), _ONE_DECIDES)
