"""Machines as folders: a Raspberry Pi 4, a laptop, and one without sensors."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from modules.host.sensors import Battery, Host
from modules.host.task import HostSensors

MEMINFO = "MemTotal:        4000000 kB\nMemFree:          100000 kB\nMemAvailable:    1000000 kB\n"
PSI = "some avg10=41.50 avg60=3.00 avg300=1.00 total=1\nfull avg10=9.00 avg60=0.00 avg300=0.00 total=0\n"

RASPBERRY_PI = {
    "sys/class/thermal/thermal_zone0/type": "cpu-thermal\n",
    "sys/class/thermal/thermal_zone0/temp": "81790\n",
    "sys/class/thermal/thermal_zone0/trip_point_0_type": "critical\n",
    "sys/class/thermal/thermal_zone0/trip_point_0_temp": "110000\n",
    "sys/class/thermal/thermal_zone0/trip_point_1_type": "active\n",
    "sys/class/thermal/thermal_zone0/trip_point_1_temp": "50000\n",
    "sys/devices/platform/soc/soc:firmware/get_throttled": "50005\n",
    **{f"sys/devices/system/cpu/cpu{core}/cpufreq/scaling_cur_freq": "600000\n" for core in range(4)},
    **{f"sys/devices/system/cpu/cpu{core}/cpufreq/cpuinfo_max_freq": "1500000\n" for core in range(4)},
    "proc/pressure/cpu": PSI,
    "proc/loadavg": "6.00 1.00 0.50 3/200 1234\n",
    "proc/meminfo": MEMINFO,
}
LAPTOP = {
    "sys/class/thermal/thermal_zone0/type": "iwlwifi_1\n",
    "sys/class/thermal/thermal_zone0/temp": "99000\n",
    "sys/class/thermal/thermal_zone1/type": "x86_pkg_temp\n",
    "sys/class/thermal/thermal_zone1/temp": "45000\n",
    "sys/class/thermal/thermal_zone2/type": "acpitz\n",
    "sys/class/thermal/thermal_zone2/temp": "-274000\n",
    "sys/class/thermal/cooling_device0/type": "Processor\n",
    "sys/class/thermal/cooling_device0/cur_state": "0\n",
    "sys/class/thermal/cooling_device1/type": "LCD\n",
    "sys/class/thermal/cooling_device1/cur_state": "3\n",
    "sys/devices/system/cpu/cpu0/thermal_throttle/core_throttle_count": "7\n",
    "sys/class/power_supply/AC/type": "Mains\n",
    "sys/class/power_supply/BAT0/type": "Battery\n",
    "sys/class/power_supply/BAT0/energy_now": "25000000\n",
    "sys/class/power_supply/BAT0/energy_full": "50000000\n",
    "sys/class/power_supply/BAT0/status": "Discharging\n",
}


@pytest.fixture
def machine(tmp_path):
    def build(files):
        for name, text in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return Host(tmp_path)

    return build


def test_a_hot_raspberry_pi(machine):
    reading = machine(RASPBERRY_PI).read()
    assert (reading.temperature, reading.headroom) == (81.8, 28.2)  # the fan's trip point is no limit
    assert (reading.frequency, reading.throttled, reading.undervoltage) == (0.4, True, True)
    assert reading.pressure == {"cpu": 0.415, "memory": None, "io": None}
    assert (reading.load, reading.memory, reading.battery) == (1.5, 0.25, None)


def test_a_past_throttling_flag_is_not_reported(machine):
    reading = machine({"sys/devices/platform/soc/soc:firmware/get_throttled": "50000\n"}).read()
    assert (reading.throttled, reading.undervoltage) == (False, False)


def test_a_laptop_on_its_battery(machine):
    reading = machine(LAPTOP).read()
    assert (reading.temperature, reading.headroom) == (45.0, None)  # neither the radio's heat, nor one that can't be
    assert (reading.throttled, reading.undervoltage) == (False, None)
    assert reading.battery == Battery(0.5, charging=False)


def test_a_core_that_was_throttled_since_the_last_look(machine):
    host = machine(LAPTOP)
    host.read()
    machine({"sys/devices/system/cpu/cpu0/thermal_throttle/core_throttle_count": "8\n"})
    assert host.read().throttled
    assert not host.read().throttled


@pytest.mark.parametrize(
    ("files", "temperature"),
    [
        ({"sys/class/hwmon/hwmon0/name": "k10temp\n", "sys/class/hwmon/hwmon0/temp1_input": "61500\n"}, 61.5),
        ({"sys/class/thermal/thermal_zone0/type": "board\n", "sys/class/thermal/thermal_zone0/temp": "40000\n"}, 40.0),
        ({"sys/class/thermal/thermal_zone0/temp": "hot\n"}, None),
    ],
)
def test_other_temperature_files(machine, files, temperature):
    assert machine(files).read().temperature == temperature


def test_a_capacity_in_percent(machine):
    battery = {"type": "Battery\n", "capacity": "104\n", "status": "Full\n"}
    files = {f"sys/class/power_supply/hid/{name}": text for name, text in battery.items()}
    assert machine(files).read().battery == Battery(1.0, charging=True)


def test_missing_sensors_read_as_none(machine):
    reading = machine({"proc/pressure/cpu": "", "proc/meminfo": "nonsense", "proc/loadavg": "x"}).read()
    assert {reading.temperature, reading.frequency, reading.throttled, reading.load, reading.memory} == {None}


def test_readings_come_until_the_end(machine):
    ended = threading.Event()
    readings = HostSensors(machine(RASPBERRY_PI)).produce(ended)
    first = next(readings)
    state: Any = first.value
    assert (first.output, state["pressure"]["cpu"], state["temperature"]) == ("state", 0.415, 81.8)
    ended.set()
    assert list(readings) == []
