"""The computer's own state, read from /proc and /sys; what a machine does not report is None, never a guess.

Kernel documentation: thermal/sysfs-api, admin-guide/pm/cpufreq, accounting/psi, ABI/testing/sysfs-class-power. The
Raspberry Pi's firmware reports undervoltage and throttling in `get_throttled` (bits 0 to 3: the current state).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

CPU_ZONE = re.compile(r"cpu|soc|x86_pkg|coretemp|k10temp|acpitz", re.IGNORECASE)
CPU_COOLING = re.compile(r"cpufreq|processor", re.IGNORECASE)
TRIPS = frozenset({"passive", "hot", "critical"})
FIRMWARE = "sys/devices/platform/soc/soc:firmware/get_throttled"
UNDERVOLTAGE, SLOWED = 0b0001, 0b1110
COLDEST, HOTTEST = -40.0, 150.0
"""Plausible degrees Celsius: sensors that are not connected report values outside."""


@dataclass(frozen=True, slots=True)
class Battery:
    """Charge from 0 to 1; whether it is charging."""

    charge: float
    charging: bool


@dataclass(frozen=True, slots=True)
class Reading:
    """One look at the machine.

    `temperature` of the CPU and `headroom` to its next thermal limit in degrees Celsius; `frequency` as part of the
    highest, mean of all cores; `throttled` because of heat or power; `pressure` is the part of the last 10 s in which
    something waited for cpu, memory or io; `load` is the number of runnable tasks per core over the last minute;
    `memory` is the part that is still available.
    """

    temperature: float | None
    headroom: float | None
    frequency: float | None
    throttled: bool | None
    undervoltage: bool | None
    pressure: dict[str, float | None]
    load: float | None
    memory: float | None
    battery: Battery | None


class Host:
    """A machine whose /proc and /sys are below `root`; remembers the throttle counters of the last reading."""

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root
        self._throttled_before: int | None = None

    def read(self) -> Reading:
        """Look at everything once."""
        temperature, headroom = self._heat()
        firmware = _number(self._root / FIRMWARE, base=16)
        return Reading(
            temperature=temperature,
            headroom=headroom,
            frequency=self._frequency(),
            throttled=self._throttled(firmware),
            undervoltage=None if firmware is None else bool(int(firmware) & UNDERVOLTAGE),
            pressure={name: self._pressure(name) for name in ("cpu", "memory", "io")},
            load=self._load(),
            memory=self._memory(),
            battery=self._battery(),
        )

    def _heat(self) -> tuple[float | None, float | None]:
        """The hottest CPU zone (of all zones, where none has such a name), and the least way to a limit."""
        zones = list(self._root.glob("sys/class/thermal/thermal_zone*"))
        chosen = [zone for zone in zones if CPU_ZONE.search(_text(zone / "type") or "")] or zones
        heats = [(zone, heat) for zone in chosen if (heat := _degrees(zone / "temp")) is not None]
        if not heats:
            return self._hwmon(), None
        rooms = [limit - heat for zone, heat in heats for limit in _limits(zone)]
        return max(heat for _, heat in heats), round(min(rooms), 1) if rooms else None

    def _hwmon(self) -> float | None:
        chips = [
            chip for chip in self._root.glob("sys/class/hwmon/hwmon*") if CPU_ZONE.search(_text(chip / "name") or "")
        ]
        heats = [heat for chip in chips for file in chip.glob("temp*_input") if (heat := _degrees(file)) is not None]
        return max(heats, default=None)

    def _frequency(self) -> float | None:
        parts = []
        for core in self._cores("cpufreq"):
            now, most = _number(core / "scaling_cur_freq"), _number(core / "cpuinfo_max_freq")
            if now is not None and most:
                parts.append(now / most)
        return round(sum(parts) / len(parts), 3) if parts else None

    def _throttled(self, firmware: float | None) -> bool | None:
        """Whether firmware, a cooling device or a throttle counter reports throttling; None when none is available."""
        signs = [] if firmware is None else [bool(int(firmware) & SLOWED)]
        for device in self._root.glob("sys/class/thermal/cooling_device*"):
            state = _number(device / "cur_state")
            if state is not None and CPU_COOLING.search(_text(device / "type") or ""):
                signs.append(state > 0)
        counts = [_number(core / "core_throttle_count") for core in self._cores("thermal_throttle")]
        known = [int(count) for count in counts if count is not None]
        if known:
            before, self._throttled_before = self._throttled_before, sum(known)
            signs.append(before is not None and sum(known) > before)
        return any(signs) if signs else None

    def _cores(self, folder: str) -> Iterator[Path]:
        return self._root.glob(f"sys/devices/system/cpu/cpu[0-9]*/{folder}")

    def _pressure(self, resource: str) -> float | None:
        match = re.search(r"^some avg10=([0-9.]+)", _text(self._root / f"proc/pressure/{resource}") or "", re.MULTILINE)
        return round(float(match[1]) / 100, 4) if match else None

    def _load(self) -> float | None:
        fields = (_text(self._root / "proc/loadavg") or "").split()
        cores = len(list(self._root.glob("sys/devices/system/cpu/cpu[0-9]*")))
        try:
            return round(float(fields[0]) / cores, 3)
        except (IndexError, ValueError, ZeroDivisionError):
            return None

    def _memory(self) -> float | None:
        sizes = dict(re.findall(r"^(\w+):\s+([0-9]+) kB", _text(self._root / "proc/meminfo") or "", re.MULTILINE))
        total = int(sizes.get("MemTotal", 0))
        return round(int(sizes["MemAvailable"]) / total, 4) if total and "MemAvailable" in sizes else None

    def _battery(self) -> Battery | None:
        """The first battery; capacity where the driver reports it, else energy or charge."""
        for supply in sorted(self._root.glob("sys/class/power_supply/*")):
            if _text(supply / "type") != "Battery":
                continue
            charge = _part(supply / "capacity", 100.0)
            for now, full in (("energy_now", "energy_full"), ("charge_now", "charge_full")):
                charge = _part(supply / now, _number(supply / full)) if charge is None else charge
            if charge is not None:
                return Battery(charge, _text(supply / "status") in ("Charging", "Full"))
        return None


def _limits(zone: Path) -> Iterator[float]:
    for kind in zone.glob("trip_point_*_type"):
        limit = _degrees(kind.with_name(kind.name.replace("_type", "_temp")))
        if limit is not None and _text(kind) in TRIPS:
            yield limit


def _degrees(file: Path) -> float | None:
    value = _number(file)
    return round(value / 1000, 1) if value is not None and COLDEST <= value / 1000 <= HOTTEST else None


def _part(file: Path, full: float | None) -> float | None:
    value = _number(file)
    return round(min(max(value / full, 0.0), 1.0), 3) if value is not None and full else None


def _number(file: Path, *, base: int = 10) -> float | None:
    try:
        return float(int(_text(file) or "", base))
    except ValueError:
        return None


def _text(file: Path) -> str | None:
    """A file's content; None when it is missing, or its driver refuses."""
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None
