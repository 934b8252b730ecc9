"""What one policy wants of its containers, whichever actuator makes it real. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.policy.spec import Control, Transition

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Order:
    """What one policy wants of its containers, all amounts in thousandths of a core.

    `claimed` are its containers, `nodes` maps each to its node. `shares` are the plan's, by container; `capacity` is N,
    by node. A claimed container without a share keeps what it has. `ceilings` are the limits where only weights move.
    """

    policy: str
    claimed: frozenset[str]
    shares: Mapping[str, int] = field(default_factory=dict)
    capacity: Mapping[str, int] = field(default_factory=dict)
    control: Control = Control.LIMIT
    ceilings: Mapping[str, int] = field(default_factory=dict)
    nodes: Mapping[str, str] = field(default_factory=dict)
    transition: Transition = Transition.STRICT
