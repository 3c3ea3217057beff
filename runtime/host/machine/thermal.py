"""Temperatures, frequencies and supply of a computer, at present."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runtime.host.machine.probe import Machine


def thermal(machine: Machine) -> dict[str, Any]:
    """Return the temperatures in °C, the frequencies in MHz, and whether the supply of a Raspberry Pi is too low."""
    zones = {}
    for name in machine.glob("/sys/class/thermal/thermal_zone*/temp"):
        with suppress(ValueError):
            zones[machine.read(name.replace("/temp", "/type")) or name] = int(machine.read(name)) / 1000.0
    frequencies = [
        int(text) / 1000.0
        for name in machine.glob("/sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_cur_freq")
        if (text := machine.read(name)).isdigit()
    ]
    alarms = [machine.read(name) for name in machine.glob("/sys/class/hwmon/hwmon*/in0_lcrit_alarm")]
    return {
        "temperatures": zones,
        "frequencies": frequencies,
        "undervoltage alarm": None if not alarms else "1" in alarms,
    }
