"""Checks of kernel and hardware: scheduling latency and clock source."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from runtime.host.machine.finding import BAD, OK, UNKNOWN, WORSE, Finding
from runtime.host.machine.probe import JETSON, PI
from runtime.host.system import processors

if TYPE_CHECKING:
    from runtime.host.machine.finding import Wants
    from runtime.host.machine.probe import Machine

FAST_CLOCKS = {"tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page", "riscv_clocksource"}
SHARE_MINIMUM = 0.9  # fraction of a period for real-time threads


def _preemption(machine: Machine, wants: Wants) -> Finding:
    version = machine.read("/proc/version")
    name = "preemption"
    why = "the loop waits while the kernel works for another program"
    if machine.read("/sys/kernel/realtime") == "1" or re.search("PREEMPT[_ ]RT", version):
        return Finding(name, OK, "PREEMPT_RT")
    if "PREEMPT_DYNAMIC" in version:
        model = dynamic_model(machine)
        if model in ("full", "lazy"):
            return Finding(name, OK, f"preemptible (PREEMPT_DYNAMIC, {model}), not PREEMPT_RT")
        if model:
            cure = "add preempt=full to the kernel's command line, or better: " + patient(machine)
            return Finding(name, WORSE, f"{model} (PREEMPT_DYNAMIC)", why, cure)
        return Finding(
            name, UNKNOWN, "PREEMPT_DYNAMIC, whose model only root can read", why, "run the doctor with sudo"
        )
    if "PREEMPT" in version:
        return Finding(name, OK, "preemptible (PREEMPT), not PREEMPT_RT")
    if version:
        return Finding(name, WORSE, "the kernel is not preemptible", why, patient(machine))
    return Finding(name, UNKNOWN, "there is no /proc/version", why)


def dynamic_model(machine: Machine) -> str:
    """Return none, voluntary, full or lazy; "" if unknown."""
    chosen = re.search(r"\((\w+)\)", machine.read("/sys/kernel/debug/sched/preempt"))
    asked = re.search(r"\bpreempt=(\w+)", machine.read("/proc/cmdline"))
    match = chosen or asked
    if match:
        return match[1]
    models = {"PREEMPT_NONE": "none", "PREEMPT_VOLUNTARY": "voluntary", "PREEMPT": "full", "PREEMPT_LAZY": "lazy"}
    return next((model for option, model in models.items() if machine.kernel_option(option) == "y"), "")


def patient(machine: Machine) -> str:
    """Return how to install a PREEMPT_RT kernel on this machine."""
    if machine.kind == PI:
        return "sudo apt install linux-image-rpi-v8-rt, and kernel=kernel8_rt.img in config.txt"
    if machine.kind == JETSON:
        return (
            "sudo apt install nvidia-l4t-rt-kernel nvidia-l4t-rt-kernel-headers nvidia-l4t-rt-kernel-oot-modules"
            " nvidia-l4t-display-rt-kernel (from NVIDIA's rt-kernel repository)"
        )
    if "Ubuntu" in machine.system:
        return "sudo pro enable realtime-kernel"
    if "Debian" in machine.system:
        return f"sudo apt install linux-image-rt-{'arm64' if machine.output('uname', '-m') == 'aarch64' else 'amd64'}"
    return "install a kernel with PREEMPT_RT"


def _real_time_share(machine: Machine, wants: Wants) -> Finding:
    name, file = "real-time share", "/proc/sys/kernel/sched_rt_"
    runtime, period = machine.read(file + "runtime_us"), machine.read(file + "period_us")
    if not runtime:
        return Finding(name, UNKNOWN, f"{file}runtime_us cannot be read")
    cure = "sudo sysctl -w kernel.sched_rt_runtime_us=950000"
    if runtime == "-1":
        return Finding(name, OK, "unlimited; a run removes the priority of a loop that hangs")
    share = int(runtime) / int(period or 1_000_000)
    if share == 0.0:
        return Finding(name, BAD, "none", "no thread may have real-time priority", cure, "share", "950000")
    verdict = OK if share >= SHARE_MINIMUM else WORSE
    return Finding(
        name,
        verdict,
        f"{100 * share:.3g} % of the time",
        "a loop that has used up its share is stopped for the rest of the second",
        cure,
        "share" if verdict == WORSE else "",
        "950000",
    )


def _clock_source(machine: Machine, wants: Wants) -> Finding:
    folder = "/sys/devices/system/clocksource/clocksource0/"
    now, others = machine.read(folder + "current_clocksource"), machine.read(folder + "available_clocksource").split()
    if not now:
        return Finding("clock source", UNKNOWN, "cannot be read")
    if now in FAST_CLOCKS:
        return Finding("clock source", OK, now)
    better = next((other for other in others if other in FAST_CLOCKS), None)
    cure = (
        f"add clocksource={better} to the kernel's command line"
        if better
        else ("see the reason: dmesg | grep -i clocksource")
    )
    return Finding("clock source", WORSE, now, "every clock reading is a system call of a microsecond or more", cure)


def _word_size(machine: Machine, wants: Wants) -> Finding:
    kernel, bits = machine.output("uname", "-m"), machine.output("getconf", "LONG_BIT")
    if not kernel or not bits:
        return Finding("word size", UNKNOWN, "neither uname nor getconf reports it")
    if bits == "64":
        return Finding("word size", OK, f"64 bits ({kernel})")
    under = " on a 64-bit kernel" if kernel in ("aarch64", "x86_64") else ""
    cure = "install the 64-bit Raspberry Pi OS" if machine.kind == PI else "install a 64-bit system"
    return Finding(
        "word size",
        BAD,
        f"{bits}-bit programs{under} ({kernel})",
        "the dependencies of Tickwork are not built for 32 bits",
        cure,
    )


def _processors_there(machine: Machine, wants: Wants) -> Finding:
    online = len(processors(machine.read("/sys/devices/system/cpu/online")))
    isolated = sorted(processors(machine.read("/sys/devices/system/cpu/isolated")))
    if not online:
        return Finding("processors", UNKNOWN, "cannot be counted")
    if online == 1:
        return Finding(
            "processors",
            WORSE,
            "1",
            "the loop shares it with the recorder and all other processes",
            "use a machine with two or more",
        )
    which = ", ".join(map(str, isolated))
    return Finding("processors", OK, f"{online}, " + (f"isolated: {which}" if isolated else "none isolated"))


def _hardware(machine: Machine, wants: Wants) -> Finding:
    version, info = machine.read("/proc/version"), machine.read("/proc/cpuinfo")
    virtual = "a virtual machine" if re.search(r"^flags\s*:.*\bhypervisor\b", info, re.MULTILINE) else None
    if "microsoft" in version.lower():
        virtual = "WSL"
    if virtual:
        return Finding(
            "hardware",
            WORSE,
            virtual,
            "its host suspends processors for milliseconds, regardless of priority",
            "fine for simulation; use a physical machine for a robot",
        )
    return Finding("hardware", OK, machine.model or "not a virtual machine")


CHECKS = (_preemption, _real_time_share, _clock_source, _word_size, _processors_there, _hardware)
