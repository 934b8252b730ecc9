"""In which order policies publish when containers change hands: agents refuse what still belongs to another. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping


class Holdings(NamedTuple):
    """A policy's containers."""

    before: frozenset[str]
    after: frozenset[str]


class Handover(NamedTuple):
    """Policies in the order in which they publish; those in `again` do so once more at the end.

    They took a container before its owner had given it up, as where two policies swap theirs.
    """

    order: list[str]
    again: list[str]


def givers_first(holdings: Mapping[str, Holdings]) -> Handover:
    """The order of `holdings`, but the policy that gives a container up comes before the one that takes it."""
    givers = {container: policy for policy, (before, after) in holdings.items() for container in before - after}
    if not givers:
        return Handover(list(holdings), [])
    waits_for = {
        policy: {givers[container] for container in (after - before) & givers.keys()}
        for policy, (before, after) in holdings.items()
    }
    found, left = Handover([], []), dict.fromkeys(holdings)
    while left:
        policy = next((one for one in left if waits_for[one].isdisjoint(left)), None)
        if policy is None:
            policy = next(iter(left))
            found.again.append(policy)
        del left[policy]
        found.order.append(policy)
    return found
