"""Kubernetes quantities and durations as plain numbers, and back."""

from __future__ import annotations

import re
from decimal import Decimal

_CPU = re.compile(r"(?P<milli>[0-9]{1,9})m|(?P<cores>[0-9]{1,6}(\.[0-9]{1,3})?)")
_MEMORY = re.compile(r"(?P<number>[0-9]{1,15}(\.[0-9]{1,3})?)(?P<unit>[kMGTPE]i?|Ki|m)?")
_DURATION = re.compile(r"([0-9]{1,9}(?:\.[0-9]{1,6})?)(ms|s|m|h)")
_SECONDS = {"ms": Decimal("0.001"), "s": Decimal(1), "m": Decimal(60), "h": Decimal(3600)}
_BYTES = (
    {"": Decimal(1), "m": Decimal("0.001")}
    | {
        prefix + suffix: Decimal(base) ** power
        for power, prefix in enumerate("kMGTPE", start=1)
        for suffix, base in (("", 1000), ("i", 1024))
    }
    | {"Ki": Decimal(1024)}
)

CPU_ALLOWED = 'a CPU quantity such as "300m", "2" or "0.5"'
MEMORY_ALLOWED = 'a memory quantity such as "100Mi" or "1Gi"'
DURATION_ALLOWED = 'a duration such as "500ms", "1.5s" or "1m30s"'


def parse_cpu(raw: object) -> int:
    """Thousandths of a core; ValueError when it is no CPU quantity."""
    match = _CPU.fullmatch(_text(raw))
    if match is None:
        raise ValueError(CPU_ALLOWED)
    if match["milli"]:
        return int(match["milli"])
    return int((Decimal(match["cores"]) * 1000).to_integral_value())


def parse_memory(raw: object) -> int:
    """Bytes; ValueError when it is no memory quantity."""
    match = _MEMORY.fullmatch(_text(raw))
    if match is None:
        raise ValueError(MEMORY_ALLOWED)
    return int(Decimal(match["number"]) * _BYTES[match["unit"] or ""])


def parse_duration(raw: object) -> float:
    """Seconds; ValueError when it is no duration. Several units add up, as in Go: 1m30s."""
    text = raw if isinstance(raw, str) else ""
    parts = _DURATION.findall(text)
    if not parts or "".join(number + unit for number, unit in parts) != text:
        raise ValueError(DURATION_ALLOWED)
    return float(sum(Decimal(number) * _SECONDS[unit] for number, unit in parts))


def format_cpu(millis: int) -> str:
    """The shortest quantity: 2000 -> "2", 1490 -> "1490m"."""
    return str(millis // 1000) if millis % 1000 == 0 else f"{millis}m"


def _text(raw: object) -> str:
    if isinstance(raw, bool) or not isinstance(raw, str | int | float):
        return ""
    return str(raw)
