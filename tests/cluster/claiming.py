"""Claims where no namespace has a priority and nothing was resized before, unless a test says so."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.cluster import claims
from contextpolicy.policy.tenants import Tenants

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from contextpolicy.cluster.claims import Claim
    from contextpolicy.cluster.matches import Original
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.policy.spec import Policy

NO_PRIORITIES = Tenants()


def never_resized(_uid: str, _container: str) -> None:
    """A container has what its pod's spec says."""


def claim(
    policies: Sequence[Policy],
    pods: Iterable[PodView],
    nodes: Mapping[str, int],
    original: Original = never_resized,
    tenants: Tenants = NO_PRIORITIES,
    **more: Any,
) -> dict[str, Claim]:
    """What each policy gets, by reference."""
    return claims.claim(policies, pods, nodes, original, tenants, **more)
