"""Quantities of CPU and memory as the API server writes them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from kubernetes.utils.quantity import parse_quantity

if TYPE_CHECKING:
    from decimal import Decimal

MAGNITUDE = 18
"""The most digits after the first that a quantity may have: Kubernetes' own fit 64 bits."""
LARGEST_QUANTITY = 2**63 - 1
"""What Kubernetes takes greater ones for."""


def millicores(raw: object) -> int | None:
    """A CPU quantity in thousandths of a core, rounded up as Kubernetes does; ValueError when it is invalid."""
    return None if raw is None else _quantity(raw, 1000)


def in_bytes(raw: object) -> int | None:
    """A quantity of memory in bytes; ValueError when it is invalid."""
    return None if raw is None else _quantity(raw, 1)


def _quantity(raw: object, scale: int) -> int:
    try:
        number: Decimal = parse_quantity(str(raw))  # type: ignore[no-untyped-call]
        if number.adjusted() > MAGNITUDE:  # a few letters that would take seconds to write out
            return 0 if number.is_zero() else -LARGEST_QUANTITY if number < 0 else LARGEST_QUANTITY
        return math.ceil(number * scale)
    except ArithmeticError as error:  # a number beyond all bounds
        raise ValueError(f"{raw!r} is not a quantity") from error
