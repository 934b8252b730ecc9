"""Which tasks' rest silences which streams."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from contextpolicy.policy.key_expressions import meet
from contextpolicy.policy.spec import Shadow
from contextpolicy.policy.validation.cases import never_hold

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.stream_spec import Stream


def without_health(policy: Policy) -> Policy:
    """The policy without producers of modules' health, which modules also publish while suspended."""
    health = (policy.shadow or Shadow(of="")).health
    return replace(policy, streams=tuple(_without(one, health) for one in policy.streams))


def _without(stream: Stream, health: str) -> Stream:
    # A filter may drop what a suspended module says of itself.
    dropped = stream.filter and never_hold(stream.filter, f"{stream.name}.suspended")
    return stream if dropped or not meet(stream.key, health) else replace(stream, produced_by=None)
