"""Checks of power management: processor frequency, idle states, sleep and supply voltage."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from runtime.host.machine.finding import BAD, OK, UNKNOWN, WORSE, Finding
from runtime.host.machine.probe import JETSON, PI
from runtime.host.machine.realtime import IDLE_DEVICE
from runtime.host.machine.sleep import MASK, can_sleep
from runtime.host.system import CAP_IPC_LOCK, processors

if TYPE_CHECKING:
    from runtime.host.machine.finding import Wants
    from runtime.host.machine.probe import Machine

WAKE_LATENCY_LIMIT = 20  # µs
CPU = "/sys/devices/system/cpu"
GET_THROTTLED = "/sys/devices/platform/soc/soc:firmware/get_throttled"
THROTTLED = {  # bit of get_throttled, set at present; 16 bits higher: set since the start
    0: "under-voltage",
    1: "frequency capped",
    2: "throttled",
    3: "too hot",
}


def _governor(machine: Machine, wants: Wants) -> Finding:
    governors = [machine.read(name) for name in machine.glob(f"{CPU}/cpu[0-9]*/cpufreq/scaling_governor")]
    if not governors:
        return Finding("governor", OK, "the system does not control the frequency")
    others = sorted(set(governors) - {"performance"})
    if not others:
        return Finding("governor", OK, f"performance on {len(governors)} processors")
    return Finding(
        "governor",
        WORSE,
        f"{', '.join(others)} on {len([name for name in governors if name in others])} of {len(governors)} processors",
        "a processor that slowed down while the loop slept takes longer for the next tick",
        f"echo performance | sudo tee {CPU}/cpu*/cpufreq/scaling_governor",
        "governor",
    )


def idle_states(machine: Machine, wants: Wants) -> Finding:
    """Check the deepest enabled idle state. `disable` is per state; `latency` is the maximum time to wake."""
    states = {}
    for name in machine.glob(f"{CPU}/cpu0/cpuidle/state*/latency"):
        folder = name.rpartition("/")[0]
        if machine.read(f"{folder}/disable") != "1":
            states[machine.read(f"{folder}/name")] = int(machine.read(name) or 0)
    if not states:
        return Finding("idle states", OK, "none")
    deepest = max(states, key=states.__getitem__)
    state = f"{deepest} takes {states[deepest]} µs to wake up"
    if states[deepest] <= WAKE_LATENCY_LIMIT:
        return Finding("idle states", OK, state)
    device = machine.devices("cpu_dma_latency")
    if device and device[0].usable:
        return Finding("idle states", OK, f"{state}; --realtime prevents it")
    if not device:
        return Finding(
            "idle states",
            WORSE,
            f"{state}, and there is no {IDLE_DEVICE}",
            "the loop wakes late by this time",
            "boot with cpuidle.off=1",
        )
    return Finding(
        "idle states",
        WORSE,
        f"{state}, and {machine.user} may not open {IDLE_DEVICE}",
        "the loop wakes late by this time",
        'add the group realtime and a udev rule: KERNEL=="cpu_dma_latency", GROUP="realtime", MODE="0660"',
        "limits",
    )


def sleep(machine: Machine, wants: Wants) -> Finding:
    """Check whether the computer can be suspended during a run."""
    if not can_sleep(machine):
        return Finding("sleep", OK, "this computer cannot be suspended")
    if machine.exists("/usr/bin/systemd-inhibit") or machine.exists("/bin/systemd-inhibit"):
        return Finding("sleep", OK, "possible; a run on a rig inhibits it")
    return Finding(
        "sleep",
        WORSE,
        "possible, and there is no systemd-inhibit",
        "a drive without a time-out keeps its last command while the computer is suspended",
        MASK,
    )


def throttling(machine: Machine, wants: Wants) -> Finding | None:
    """Check the firmware's throttling bits: of vcgencmd, or the file in /sys with the same number without 0x."""
    if machine.kind != PI:
        return None
    text = machine.read(GET_THROTTLED) or machine.output("vcgencmd", "get_throttled").rpartition("=")[2]
    if not text:
        return Finding("throttling", UNKNOWN, "neither the firmware nor vcgencmd reports it")
    bits = int(text, 16)
    now = [meaning for bit, meaning in THROTTLED.items() if bits >> bit & 1]
    earlier = [meaning for bit, meaning in THROTTLED.items() if bits >> bit + 16 & 1]
    cure = (
        "use a supply of 5.1 V and 3 A (Pi 5: 5 A) with a short, thick cable, a separate supply for motors, and a fan"
    )
    why = "the firmware slows the processors down, even within a step"
    if now:
        return Finding("throttling", BAD, f"now: {', '.join(now)} (0x{bits:x})", why, cure)
    if earlier:
        return Finding("throttling", WORSE, f"since the start: {', '.join(earlier)} (0x{bits:x})", why, cure)
    return Finding("throttling", OK, "never since the start")


def _power_mode(machine: Machine, wants: Wants) -> Finding | None:
    if machine.kind != JETSON:
        return None
    models = re.findall(r"<\s*POWER_MODEL\s+ID=(\d+)\s+NAME=(\S+)\s*>", machine.read("/etc/nvpmodel.conf"))
    modes = {int(number): name for number, name in models}
    asked = re.search(r"NV Power Mode: (\S+)\s+(\d+)", machine.output("nvpmodel", "-q"))
    stored = re.search(r"pmode:(\d+)", machine.read("/var/lib/nvpmodel/status"))
    now = asked[2] if asked else stored[1] if stored else None
    if not modes or now is None:
        return Finding("power mode", UNKNOWN, "not reported by nvpmodel", cure="sudo nvpmodel -q")
    now = int(now)
    best = max(modes, key=lambda number: strength(modes[number]))
    if now == best:
        return Finding("power mode", OK, modes[now])
    return Finding(
        "power mode",
        WORSE,
        f"{modes.get(now, now)}; {modes[best]} is available",
        "processors are switched off or held below their frequency",
        f"sudo nvpmodel -m {best}",
        "power mode",
        str(best),
    )


def strength(mode: str) -> float:
    """Return the power of a mode in W; infinity for MAXN, which has no limit."""
    watts = re.search(r"(\d+)W", mode)
    return float("inf") if mode.startswith("MAXN") else float(watts[1]) if watts else 0.0


def _clocks(machine: Machine, wants: Wants) -> Finding | None:
    if machine.kind != JETSON:
        return None
    least, most = (machine.read(f"{CPU}/cpu0/cpufreq/scaling_{end}_freq") for end in ("min", "max"))
    if not least or not most:
        return Finding("clocks", UNKNOWN, "the frequencies cannot be read")
    if least == most:
        return Finding("clocks", OK, f"locked at {int(most) / 1e6:.2f} GHz")
    return Finding(
        "clocks",
        WORSE,
        f"from {int(least) / 1e6:.2f} to {int(most) / 1e6:.2f} GHz",
        "clocks that follow the load are slow when the tick begins",
        "sudo jetson_clocks",
        "clocks",
    )


def _swap(machine: Machine, wants: Wants) -> Finding:
    swaps = [line.split()[0] for line in machine.read("/proc/swaps").splitlines()[1:]]
    if not swaps:
        return Finding("swap", OK, "none")
    names = swaps[0] + (f" and {len(swaps) - 1} more" if len(swaps) > 1 else "")
    if machine.limit("Max locked memory") is None or machine.capable(CAP_IPC_LOCK):
        return Finding("swap", OK, f"{names}; --realtime locks what a run needs")
    return Finding(
        "swap",
        WORSE,
        names,
        "memory that was paged out must be read back within a tick",
        "let this user lock memory (see memlock), or sudo swapoff -a",
        "limits",
    )


def _interrupts(machine: Machine, wants: Wants) -> Finding:
    balanced, isolated = machine.runs("irqbalance"), processors(machine.read(f"{CPU}/isolated"))
    if balanced and isolated and "IRQBALANCE_BANNED" not in machine.read("/etc/default/irqbalance"):
        return Finding(
            "interrupts",
            WORSE,
            "irqbalance runs, with processors isolated",
            "it may move interrupts to the processor of the loop",
            "sudo systemctl disable --now irqbalance",
        )
    return Finding("interrupts", OK, "balanced by irqbalance" if balanced else "not balanced")


CHECKS = (_governor, idle_states, sleep, throttling, _power_mode, _clocks, _swap, _interrupts)
