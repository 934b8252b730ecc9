"""CPU weights in the kernel's units, from thousandths of a core as the kubelet and the runtime convert them. Pure.

Version 1 counts shares, 1024 for a core. Version 2 counts from 1 to 10000, and the two levels convert differently: the
kubelet's pods linearly (KEP-2254; `CpuSharesToCpuWeight` in kubelet/cm), a runtime's containers so that 1024 shares are
the default of 100 (`ConvertCPUSharesToCgroupV2Value` in opencontainers/cgroups). Older runtimes, such as runc before
1.3.2, convert a container's linearly too. A task's weight so compares with that of the unmanaged pods and sidecars
beside it.
"""

from __future__ import annotations

from math import ceil, log2, log10, sqrt

FILES = {1: "cpu.shares", 2: "cpu.weight"}
"""The file of a weight, by cgroup version."""
LEAST, MOST = {1: 2, 2: 1}, {1: 262_144, 2: 10_000}
"""The kernel's bounds, by cgroup version."""
_CORE = 1024
_FEWEST, _MANY = LEAST[1], MOST[1]
_STEP = (_MANY - _FEWEST) / (MOST[2] - 1)
"""Shares for one more of a weight, where they are converted linearly."""


def shares(millicores: int) -> int:
    """What the kubelet makes of a request of that many thousandths of a core."""
    return min(_MANY, max(_FEWEST, millicores * _CORE // 1000))


def of_pod(millicores: int, version: int) -> int:
    """A pod's weight, or a QoS class's."""
    amount = shares(millicores)
    return amount if version == 1 else 1 + (amount - _FEWEST) * (MOST[2] - 1) // (_MANY - _FEWEST)


def of_container(millicores: int, version: int, *, linear: bool = False) -> int:
    """A container's weight inside its pod; `linear`: as an older runtime converts it."""
    amount = shares(millicores)
    if version == 1 or linear or amount in (_FEWEST, _MANY):
        return amount if version == 1 else of_pod(millicores, version)
    doublings = log2(amount)
    return ceil(10 ** ((doublings * doublings + 125 * doublings) / 612 - 7 / 34))


def is_linear(weight: int, millicores: int) -> bool | None:
    """Whether the runtime converts linearly, by a container of this request; None where it shows neither."""
    found = {of_container(millicores, 2, linear=linear): linear for linear in (True, False)}
    return found.get(weight) if len(found) > 1 else None


def millicores(weight: int, version: int, *, linear: bool = False) -> int:
    """The request, in thousandths of a core, for which a container would have the weight.

    0 for the least, or for none, as a group has with `cpu.idle`. Linearly, all requests within 25m have the same:
    theirs is taken for the middle one.
    """
    if weight <= LEAST[version]:
        return 0
    amount: float = weight
    if version == 2 and linear:
        amount = _FEWEST + (weight - 0.5) * _STEP
    elif version == 2:
        amount = 2 ** ((sqrt(125**2 + 4 * 612 * (log10(weight) + 7 / 34)) - 125) / 2)
    return round(amount * 1000 / _CORE)
