"""Shell script of `doctor --script` with the remedies of findings.

The script consists of parts with a comment on the reason of each, and of the parts that were requested. Running it
again changes nothing. With DESTDIR set, it writes its files below that folder, runs no commands, and needs no root.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

from runtime.host.machine.can import speed
from runtime.host.machine.finding import OK
from runtime.host.machine.probe import PI
from runtime.host.machine.realtime import GROUP, LIMITS_FILE
from runtime.setup.doctor import access

if TYPE_CHECKING:
    from runtime.host.machine.finding import Finding, Wants
    from runtime.host.machine.probe import Machine

HEAD = """\
#!/bin/sh
# {about}
# Written by `{program} doctor --script`. Read it, then run it as root: sudo sh FILE
# Running it again changes nothing. `DESTDIR=/tmp/look sh FILE` writes its files below that folder and runs no command.
set -eu

{user}into=${{DESTDIR:-}}
if [ -z "$into" ] && [ "$(id -u)" != 0 ]; then
    echo "run this as root: sudo sh $0" >&2
    exit 1
fi

# put FILE: write standard input to the file if it differs.
put() {{
    mkdir -p "$into$(dirname "$1")"
    cat >"$into$1.new"
    if cmp -s "$into$1.new" "$into$1"; then
        rm "$into$1.new"
    else
        mv "$into$1.new" "$into$1"
        echo "wrote $1"
    fi
}}

# run COMMAND: run it unless DESTDIR is set.
run() {{
    if [ -z "$into" ]; then "$@"; else echo "not run: $*"; fi
}}
"""

CONFIG_LINE = """
# config_line LINE: add a line for all models to the Raspberry Pi's config.txt.
config={config}
config_line() {{
    mkdir -p "$into$(dirname "$config")"
    if ! grep -qxF "$1" "$into$config" 2>/dev/null; then
        printf '\\n[all]\\n%s\\n' "$1" >>"$into$config"
        echo "added to $config: $1"
        restart=yes
    fi
}}
"""
FIRMWARE_CONFIG, OLDER_CONFIG = "/boot/firmware/config.txt", "/boot/config.txt"


def script(machine: Machine, wants: Wants, findings: Sequence[Finding], program: str) -> list[str]:
    """Return the lines of the script. program : command that starts this program"""
    wanting = {}
    for finding in findings:
        if finding.part and finding.verdict != OK:
            wanting.setdefault(finding.part, []).append(finding)
    if wants.overlays and machine.kind == PI:
        wanting.setdefault("overlay", [])
    about = _one_line("; ".join(part for part in (machine.model, machine.system, f"Linux {machine.kernel}") if part))
    requested = access.parts(machine, wants)
    if not wanting and not requested:
        return ["#!/bin/sh", f"# {about}", f"# `{program} doctor --script` found nothing that a script can change."]
    parts = [
        reasons(wanting[name]) + part(wants, wanting[name]).lstrip("\n")
        for name, part in PARTS.items()
        if name in wanting
    ]
    parts += requested
    if {"overlay", "i2c speed"} & wanting.keys():
        parts.insert(0, CONFIG_LINE.format(config=FIRMWARE_CONFIG if machine.exists(FIRMWARE_CONFIG) else OLDER_CONFIG))
        parts.append('if [ "${restart:-}" = yes ]; then echo "restart for the changes in config.txt"; fi')
    person = f"user={shlex.quote(wants.user or machine.user)}\n" if any('"$user"' in part for part in parts) else ""
    parts.append('echo "done; groups and limits are in effect from the next login on"' if person else 'echo "done"')
    parts.insert(0, HEAD.format(about=about, program=program, user=person))
    return "\n\n".join(part.strip("\n") for part in parts).split("\n")


def _one_line(text: str) -> str:
    return re.sub(r"[^ -~]", " ", text)


def reasons(findings: Sequence[Finding]) -> str:
    """Return the comment above a part."""
    seen = dict.fromkeys(f"# {finding.name}: {finding.found}; {finding.why}." for finding in findings)
    return "\n".join(re.sub(r"\s", " ", line) for line in seen) + "\n"


def _limits(wants: Wants, findings: Sequence[Finding]) -> str:
    return f'''
if ! getent group {GROUP} >/dev/null; then run groupadd {GROUP}; fi
run usermod -aG {GROUP} "$user"
put {LIMITS_FILE} <<'END'
@{GROUP} - rtprio 90
@{GROUP} - memlock unlimited
END
put /etc/udev/rules.d/90-tickwork-idle.rules <<'END'
KERNEL=="cpu_dma_latency", GROUP="{GROUP}", MODE="0660"
END
run udevadm control --reload
run udevadm trigger --sysname-match=cpu_dma_latency
'''


def _share(wants: Wants, findings: Sequence[Finding]) -> str:
    runtime = "-1" if any(finding.subject == "-1" for finding in findings) else findings[0].subject
    return f"""
put /etc/sysctl.d/90-tickwork.conf <<'END'
kernel.sched_rt_runtime_us = {runtime}
END
run sysctl -q -p /etc/sysctl.d/90-tickwork.conf
"""


def _governor(wants: Wants, findings: Sequence[Finding]) -> str:
    return """
# On a desktop, power-profiles-daemon overrides this when it starts: powerprofilesctl set performance
put /etc/tmpfiles.d/90-tickwork-governor.conf <<'END'
w /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor - - - - performance
END
run systemd-tmpfiles --create /etc/tmpfiles.d/90-tickwork-governor.conf
"""


def _power_mode(wants: Wants, findings: Sequence[Finding]) -> str:
    mode = findings[0].subject
    return f"""
# If it asks for a restart, the answer is no: restart later.
if ! nvpmodel -q 2>/dev/null | grep -qx {mode}; then echo no | run nvpmodel -m {mode}; fi
"""


def _clocks(wants: Wants, findings: Sequence[Finding]) -> str:
    return """
put /etc/systemd/system/tickwork-clocks.service <<'END'
[Unit]
Description=Clocks at their highest frequency, for Tickwork
After=nvpmodel.service

[Service]
Type=oneshot
ExecStart=/usr/bin/jetson_clocks

[Install]
WantedBy=multi-user.target
END
run systemctl daemon-reload
run systemctl enable --now tickwork-clocks.service
"""


def modules(wants: Wants, findings: Sequence[Finding]) -> str:
    """Return the part for a Jetson's CAN modules. Pins: NVIDIA Jetson Linux Developer Guide, Controller Area Network"""
    return f"""
# If no interface appears, or no frame is received, configure the pins for CAN: sudo /opt/nvidia/jetson-io/jetson-io.py
# The pins need a transceiver (3.3 V) between them and the bus.
put /etc/modules-load.d/tickwork-can.conf <<'END'
can
can_raw
mttcan
END
run modprobe -a can can_raw mttcan
{can_files(wants)}"""


def overlay(wants: Wants, findings: Sequence[Finding]) -> str:
    """Return the part for a Raspberry Pi's CAN overlays. findings : none if it has a CAN interface already

    Source: boot/overlays/README of the Raspberry Pi firmware; crystals and pins: manufacturers of the HATs.
    """
    if wants.overlays:
        chosen = [f"config_line {shlex.quote('dtoverlay=' + text)}" for text in wants.overlays]
        lines = "\n".join(["# --overlay", *chosen])
    else:
        lines = """\
# The line depends on the HAT, its crystal and its interrupt pin. Uncomment yours, or pass it to the doctor:
# --overlay mcp251xfd,spi0-0,interrupt=25
# config_line 'dtoverlay=mcp2515-can0,oscillator=12000000,interrupt=25'      # Waveshare RS485 CAN HAT, 12 MHz
# config_line 'dtoverlay=mcp2515-can0,oscillator=16000000,interrupt=23'      # Waveshare 2-CH CAN HAT, first bus, 16 MHz
# config_line 'dtoverlay=mcp251xfd,spi0-0,interrupt=25'                      # MCP2518FD at the first chip select"""
    return f"""
config_line 'dtparam=spi=on'
{lines}
{can_files(wants) if findings else ""}"""


def _can(wants: Wants, findings: Sequence[Finding]) -> str:
    names = list(dict.fromkeys(finding.subject for finding in findings))
    downs = "\n".join(f"run ip link set {shlex.quote(name)} down" for name in names)
    return can_files(wants, names, downs)


def can_files(wants: Wants, names: Sequence[str] = (), downs: str = "") -> str:
    """Return the files that configure CAN interfaces.

    A unit for systemd-networkd sets the bitrate and brings the interface up; a udev rule sets the queue length, which
    older versions of networkd lack. They apply to every `can*`, so that the script of a second interface, which
    replaces them, leaves the first one configured. names : interfaces, of which those named otherwise are added
    """
    names = ["can*", *(name for name in names if not name.startswith("can"))]
    queues = "\n".join(
        f'SUBSYSTEM=="net", ACTION=="add|change", KERNEL=="{name}", ATTR{{tx_queue_len}}="{wants.queue}"'
        for name in names
    )
    data = f"DataBitRate={wants.data_bitrate}\nFDMode=yes\n" if wants.data_bitrate else ""
    return f"""
# {speed(wants.bitrate)}, restart {wants.restart} ms after a bus-off, transmit queue of one tick ({wants.queue} frames).
put /etc/systemd/network/80-tickwork-can.network <<'END'
[Match]
Name={" ".join(names)}

[Link]
RequiredForOnline=no

[CAN]
BitRate={wants.bitrate}
{data}RestartSec={wants.restart}ms
END
put /etc/udev/rules.d/90-tickwork-can.rules <<'END'
{queues}
END
run udevadm control --reload
run udevadm trigger --subsystem-match=net --sysname-match='can*'
{downs}
if ! systemctl -q is-enabled systemd-networkd 2>/dev/null; then
    run systemctl enable systemd-networkd
    # Another program manages the network: booting must not wait for this one.
    run systemctl disable systemd-networkd-wait-online || true
fi
run systemctl restart systemd-networkd
""".replace("\n\nif !", "\nif !")


def _membership(wants: Wants, findings: Sequence[Finding]) -> str:
    groups = list(dict.fromkeys(finding.subject for finding in findings if finding.subject != "root"))
    lines = "\n".join(f'run usermod -aG {shlex.quote(group)} "$user"' for group in groups)
    return f"\n{lines}\n" if lines else ""


def _i2c(wants: Wants, findings: Sequence[Finding]) -> str:
    if findings[0].subject != "root":
        return _membership(wants, findings)
    return """
if ! getent group i2c >/dev/null; then run groupadd i2c; fi
run usermod -aG i2c "$user"
put /etc/udev/rules.d/90-tickwork-i2c.rules <<'END'
SUBSYSTEM=="i2c-dev", GROUP="i2c", MODE="0660"
END
run udevadm control --reload
run udevadm trigger --subsystem-match=i2c-dev
"""


def _spi(wants: Wants, findings: Sequence[Finding]) -> str:
    return _i2c(wants, findings).replace("i2c-dev", "spidev").replace("i2c", "spi")


def _serial(wants: Wants, findings: Sequence[Finding]) -> str:
    if findings[0].subject != "root":
        return _membership(wants, findings)
    return """
run usermod -aG dialout "$user"
put /etc/udev/rules.d/90-tickwork-serial.rules <<'END'
SUBSYSTEM=="tty", KERNEL=="ttyUSB*|ttyACM*|ttyAMA*|ttyTHS*", GROUP="dialout", MODE="0660"
END
run udevadm control --reload
run udevadm trigger --subsystem-match=tty
"""


def _ftdi(wants: Wants, findings: Sequence[Finding]) -> str:
    return """
put /etc/udev/rules.d/90-tickwork-ftdi.rules <<'END'
ACTION=="add|change", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"
END
run udevadm control --reload
run udevadm trigger --subsystem-match=usb-serial
"""


def _modems(wants: Wants, findings: Sequence[Finding]) -> str:
    return """
put /etc/udev/rules.d/90-tickwork-modems.rules <<'END'
SUBSYSTEM=="tty", KERNEL=="ttyACM*|ttyUSB*", ENV{ID_MM_PORT_IGNORE}="1"
END
run udevadm control --reload
run udevadm trigger --subsystem-match=tty
run systemctl try-restart ModemManager
"""


def _i2c_speed(wants: Wants, findings: Sequence[Finding]) -> str:
    return """
config_line 'dtparam=i2c_arm_baudrate=400000'
"""


PARTS = {
    "limits": _limits,
    "share": _share,
    "governor": _governor,
    "power mode": _power_mode,
    "clocks": _clocks,
    "overlay": overlay,
    "modules": modules,
    "can": _can,
    "serial": _serial,
    "ftdi": _ftdi,
    "modems": _modems,
    "i2c": _i2c,
    "i2c speed": _i2c_speed,
    "spi": _spi,
}
