"""What one policy wants of its containers, whichever actuator makes it real. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.policy.spec import Control

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Order:
    """What one policy wants of its containers: shares per container and N per node, in thousandths of a core."""

    policy: str
    claimed: frozenset[str]
    shares: Mapping[str, int] = field(default_factory=dict)
    capacity: Mapping[str, int] = field(default_factory=dict)
    control: Control = Control.LIMIT
    ceilings: Mapping[str, int] = field(default_factory=dict)
