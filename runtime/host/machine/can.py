"""Checks of CAN interfaces: up, at the configured bitrate, healthy, and with a long enough queue."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from runtime.host.machine.finding import BAD, OK, UNKNOWN, WORSE, Finding, Wants
from runtime.host.machine.probe import JETSON, PI

if TYPE_CHECKING:
    from runtime.host.machine.probe import Machine

ARPHRD_CAN = "280"
QUEUE_MINIMUM = 64  # frames
STATES = {
    "ERROR-WARNING": (WORSE, "frames are lost or not acknowledged"),
    "ERROR-PASSIVE": (BAD, "no frame is acknowledged: check wiring, termination, bitrate and drive power"),
    "BUS-OFF": (BAD, "the controller left the bus after too many errors: check wiring, termination and bitrate"),
}


def _can_interfaces(machine: Machine, wants: Wants) -> list[Finding] | Finding:
    """Check every CAN interface of the machine."""
    names = [name.split("/")[-2] for name in machine.glob("sys/class/net/*/type") if machine.read(name) == ARPHRD_CAN]
    if not names:
        return _none(machine)
    try:
        links = {link.get("ifname"): link for link in json.loads(machine.output("ip", "-details", "-json", "link"))}
    except ValueError:
        links = {}
    return [finding for name in names for finding in interface(machine, wants, name, links.get(name))]


def _none(machine: Machine) -> Finding:
    """Return the finding on a machine without CAN interfaces."""
    why = "actuators are controlled over CAN"
    if machine.kind == PI:
        return Finding(
            "CAN",
            WORSE,
            "no interface",
            why,
            "the overlay of your HAT in config.txt, as in dtoverlay=mcp251xfd,spi0-0,interrupt=25, or a USB adapter",
            "overlay",
        )
    if machine.kind == JETSON:
        return Finding(
            "CAN",
            WORSE,
            "no interface",
            why,
            "sudo modprobe mttcan, and a transceiver at the CAN pins; or a USB adapter",
            "modules",
        )
    return Finding("CAN", OK, "no interface; a simulation needs none")


def interface(machine: Machine, wants: Wants, name: str, link: dict[str, Any] | None) -> list[Finding]:
    """Return the findings of one interface: one for each problem, or a single one without any."""
    driver = machine.target(f"/sys/class/net/{name}/device/driver")
    queue = int(machine.read(f"/sys/class/net/{name}/tx_queue_len") or 0)
    up = machine.read(f"/sys/class/net/{name}/operstate") != "down"
    about: dict[str, Any] = (link or {}).get("linkinfo") or {}
    if about.get("info_kind") in ("vcan", "vxcan"):
        return [Finding(name, OK, "virtual")]
    cure = bring_up(name, wants.bitrate, wants.restart, wants.queue, wants.data_bitrate)
    if not up:
        return [Finding(name, BAD, "is down", "nothing is sent or received", cure, "can", name)]
    problems: list[Finding] = []

    def report(verdict: str, found: str, why: str, cure: str, part: str = "can") -> None:
        problems.append(Finding(name, verdict, found, why, cure, part, name))

    down_first = f"sudo ip link set {name} down && {cure}"
    data: dict[str, Any] = about.get("info_data") or {}
    bitrate, data_bitrate = bitrates(data)
    state, restart = data.get("state", ""), data.get("restart_ms")
    if bitrate is None:
        report(
            UNKNOWN,
            "its bitrate is unknown",
            "no frame is received at a bitrate other than the drives'",
            f"see: ip -details link show {name}" if link else "sudo apt install iproute2",
            "",
        )
    elif bitrate != wants.bitrate:
        report(
            BAD,
            f"{speed(bitrate)}, not {speed(wants.bitrate)}",
            "no frame is received at a bitrate other than the drives'",
            f"{down_first} (if intended: --bitrate {bitrate})",
        )
    if bitrate is not None and wants.data_bitrate and data_bitrate != wants.data_bitrate:
        found = f"sends data of CAN FD at {speed(data_bitrate)}" if data_bitrate else "classic CAN"
        report(
            BAD,
            f"{found}, not CAN FD at {speed(wants.data_bitrate)}",
            "no frame of CAN FD is received or sent at another bitrate than the drives'",
            down_first,
        )
    if state in STATES:
        verdict, why = STATES[state]
        errors: dict[str, int] = data.get("berr_counter") or {}
        count = f" ({errors['tx']} errors sending, {errors['rx']} receiving)" if {"tx", "rx"} <= errors.keys() else ""
        report(verdict, state + count, why, "120 Ω at both ends, CAN_H to CAN_H, drives on, one bitrate for all", "")
    if restart == 0:
        report(
            WORSE,
            "does not restart automatically",
            "after bus-off it stays off the bus until it is taken down and up again",
            down_first,
        )
    if queue < QUEUE_MINIMUM:
        report(
            WORSE,
            f"transmit queue of {queue} frames",
            "the commands of many drives in one tick do not fit; the last are dropped",
            f"sudo ip link set {name} txqueuelen {wants.queue}",
        )
    if driver == "mcp251x":
        report(
            WORSE,
            "an MCP2515, which holds two frames",
            "replies of several drives at 1 Mbit/s overrun its buffer and are lost",
            "use an adapter with an MCP2518FD, or a USB adapter (candleLight)",
            "",
        )
    words = [speed(bitrate) if bitrate else "", state, f"transmit queue of {queue} frames", driver]
    return problems or [Finding(name, OK, ", ".join(word for word in words if word))]


def bitrates(data: dict[str, Any]) -> tuple[int | None, int | None]:
    """Return (bitrate, data bitrate of CAN FD) of a controller in bit/s, None if unknown. data : info_data of `link`"""
    nominal: dict[str, int] = data.get("bittiming") or {}
    fast: dict[str, int] = data.get("data_bittiming") or {}
    return nominal.get("bitrate"), fast.get("bitrate")


def bring_up(
    name: str, bitrate: float, restart: int = Wants.restart, queue: int = Wants.queue, data_bitrate: float = 0
) -> str:
    """Return the commands that bring an interface up. data_bitrate : bit/s of CAN FD, 0 for classic CAN"""
    rates = f"{bitrate} dbitrate {data_bitrate} fd on" if data_bitrate else f"{bitrate}"
    return (
        f"sudo ip link set {name} type can bitrate {rates} restart-ms {restart} && "
        f"sudo ip link set {name} txqueuelen {queue} up"
    )


def speed(bitrate: float) -> str:
    """Return a bitrate as text: '1 Mbit/s', '500 kbit/s'. bitrate : bit/s"""
    return f"{bitrate / 1e6:g} Mbit/s" if bitrate >= 1_000_000 else f"{bitrate / 1e3:g} kbit/s"


CHECKS = (_can_interfaces,)
