"""CPU, memory and durations as Kubernetes and the policy write them."""

from __future__ import annotations

import re

_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?)(ms|s|m|h)")
_SECONDS = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0}
_CPU = re.compile(r"([0-9]+)m|([0-9]+(?:\.[0-9]{1,3})?)")
_MEMORY = re.compile(r"([0-9]+)(Ki|Mi|Gi|k|M|G)?")
_BYTES = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "Ki": 2**10, "Mi": 2**20, "Gi": 2**30}

DURATION_ALLOWED = 'a duration such as "100ms" or "1.5s"'
CPU_ALLOWED = 'a CPU quantity such as "300m" or 2'
MEMORY_ALLOWED = 'a memory quantity such as "150Mi"'


def duration(text: str) -> float:
    """Parse seconds; ValueError unless it is a duration above 0."""
    match = _DURATION.fullmatch(text)
    seconds = float(match[1]) * _SECONDS[match[2]] if match else 0.0
    if seconds <= 0:
        raise ValueError(DURATION_ALLOWED)
    return seconds


def cores(text: str) -> float:
    """Parse cores; ValueError unless it is a CPU quantity above 0."""
    match = _CPU.fullmatch(text)
    amount = (int(match[1]) / 1000 if match[1] else float(match[2])) if match else 0.0
    if amount <= 0:
        raise ValueError(CPU_ALLOWED)
    return amount


def memory(text: str) -> int:
    """Parse bytes; ValueError unless it is a memory quantity above 0."""
    match = _MEMORY.fullmatch(text)
    size = int(match[1]) * _BYTES[match[2] or ""] if match else 0
    if size <= 0:
        raise ValueError(MEMORY_ALLOWED)
    return size
