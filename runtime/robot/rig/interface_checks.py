"""Checks of a CAN interface: present, up, at the configured bitrate, and not bus-off."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from runtime.host.machine.can import ARPHRD_CAN, bitrates, bring_up
from runtime.host.suggestions import suggestion
from runtime.robot.rig.errors import Refused, RigProblem

if TYPE_CHECKING:
    from typing import Any

    from runtime.host.machine.probe import Machine
    from runtime.robot.rig.file import RigBus


UP = 1  # IFF_UP
VIRTUAL = ("vcan", "vxcan")  # kinds whose nodes are all processes of this machine
FD_MTU = 72
WIRING = "CAN_H to CAN_H, 120 Ω at both ends, drives on, one bitrate for all"


@dataclass
class Fitness:
    """Result of the checks. virtual : whether all nodes are processes of this machine; remarks : for the operator"""

    virtual: bool
    remarks: list[str] = field(default_factory=list)


def look(bus: RigBus, machine: Machine) -> Fitness:
    """Check the interface of a bus. Returns its Fitness. Raises Refused with the remedy.

    bus : RigBus
    machine : runtime.host.machine.probe.Machine
    """
    name = bus.channel
    folder = f"/sys/class/net/{name}"
    if not machine.exists(folder):
        raise Refused(absent(bus, machine))
    if machine.read(f"{folder}/type") != ARPHRD_CAN:
        raise refusal(bus, "TW113", f"{name} is not a CAN interface", _interfaces_text(bus, machine))
    about = link(name, machine)
    virtual = about.get("info_kind", _name_family(name)) in VIRTUAL
    if not int(machine.read(f"{folder}/flags") or "1", 16) & UP:
        raise refusal(bus, "TW114", f"{name} is down", take_up(bus, virtual))
    if bus.fd and int(machine.read(f"{folder}/mtu") or FD_MTU) < FD_MTU:
        raise refusal(bus, "TW117", f"{name} does not carry CAN FD", _fd_commands(bus, virtual))
    return Fitness(virtual, [] if virtual else list(_controller(bus, about.get("info_data") or {})))


def link(name: str, machine: Machine) -> dict[str, Any]:
    """Return what iproute2 reports about the kind of an interface; {} for nothing."""
    try:
        links = json.loads(machine.output("ip", "-details", "-json", "link"))
    except ValueError:
        return {}
    return next((link.get("linkinfo") or {} for link in links if link.get("ifname") == name), {})


def _controller(bus, data):
    """Yield remarks on a real controller. Raises Refused for other bitrates or bus-off."""
    name, state = bus.channel, data.get("state")
    bitrate, data_bitrate = bitrates(data)
    if bitrate is not None and bitrate != bus.bitrate:
        raise refusal(
            bus, "TW115", f"{name} runs at {bitrate} bit/s, but the rig file specifies {bus.bitrate}", again(bus)
        )
    if data_bitrate is not None and bus.data_bitrate and data_bitrate != bus.data_bitrate:
        raise refusal(
            bus,
            "TW115",
            f"{name} sends data of CAN FD at {data_bitrate} bit/s, but the rig file specifies {bus.data_bitrate}",
            again(bus),
        )
    if state == "BUS-OFF":
        raise refusal(bus, "TW116", f"{name} is bus-off after too many errors", f"{WIRING}; then: {again(bus)}")
    if bitrate is None:
        yield f"{name}: its bitrate is unknown; see: ip -details link show {name}"
    if state in ("ERROR-WARNING", "ERROR-PASSIVE"):
        yield f"{name} is {state}: frames were lost or not acknowledged; {WIRING}"


def refusal(bus: RigBus, code: str, message: str, hint: str) -> Refused:
    """Return the Refused of a bus. code : key of CODES"""
    return Refused(RigProblem(code, f"[bus.{bus.name}] {message}", hint))


def _name_family(name):
    """Return the name of an interface without its number: 'can' of 'can0'."""
    return name.rstrip("0123456789")


def take_up(bus: RigBus, virtual: bool = False) -> str:
    """Return the command that brings an interface up."""
    if virtual:
        return f"sudo ip link set {bus.channel} up"
    return bring_up(bus.channel, bus.bitrate, data_bitrate=(bus.data_bitrate or bus.bitrate) if bus.fd else 0)


def again(bus: RigBus) -> str:
    """Return the command that takes an interface down and brings it up again."""
    return f"sudo ip link set {bus.channel} down && {take_up(bus)}"


def _fd_commands(bus, virtual):
    """Return the commands that bring an interface up with CAN FD."""
    if not virtual:
        return again(bus)
    name = bus.channel
    return f"sudo ip link set {name} down && sudo ip link set {name} mtu {FD_MTU} && sudo ip link set {name} up"


def absent(bus: RigBus, machine: Machine) -> RigProblem:
    """Return the problem of an interface that does not exist."""
    name = bus.channel
    if _name_family(name) == "vcan":
        remedy = f"sudo modprobe vcan && sudo ip link add {name} type vcan && sudo ip link set {name} up"
    else:
        remedy = _interfaces_text(bus, machine)
    return RigProblem("TW112", f'[bus.{bus.name}] channel = "{name}"', remedy)


def _interfaces_text(bus, machine):
    """Return a hint that lists the CAN interfaces of this machine."""
    names = [path.split("/")[-2] for path in machine.glob("sys/class/net/*/type") if machine.read(path) == ARPHRD_CAN]
    if not names:
        return (
            "this machine has no CAN interface: check that the adapter is plugged in and its driver loaded; the "
            "command `doctor` has more checks"
        )
    return suggestion(bus.channel, names) or f"this machine has {', '.join(names)}"
