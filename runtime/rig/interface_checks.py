"""Is an interface fit to carry a bus? It is there, it is CAN, it is up, at the right bitrate, and has not withdrawn."""

import json
from dataclasses import dataclass, field

from graph.names import suggestion
from runtime.machine.can import ARPHRD_CAN, bring_up
from runtime.rig.errors import Refused, Trouble

UP = 1  # IFF_UP
VIRTUAL = ("vcan", "vxcan")  # kinds on which every node is a process of this machine
FD_MTU = 72
DATA_BITRATE = 5_000_000  # bit/s of CAN FD's second part, in the commands that are proposed
WIRING = "CAN_H to CAN_H, 120 Ω at both ends, drives on, one bitrate for all"


@dataclass
class Fitness:
    """virtual : whether all other nodes are processes of this machine; remarks : what a person should know, but need
    not mend first
    """

    virtual: bool
    remarks: list = field(default_factory=list)


def look(bus, machine):
    """The Fitness of the interface behind a bus. Refused, with the cure, where it cannot carry it.

    bus : RigBus
    machine : runtime.machine.probe.Machine
    """
    name = bus.channel
    folder = f"/sys/class/net/{name}"
    if not machine.exists(folder):
        raise Refused(absent(bus, machine))
    if machine.read(f"{folder}/type") != ARPHRD_CAN:
        raise refused(bus, "TW113", f"{name} is no CAN interface", others(bus, machine))
    about = link(name, machine)
    virtual = about.get("info_kind", family(name)) in VIRTUAL
    if not int(machine.read(f"{folder}/flags") or "1", 16) & UP:
        raise refused(bus, "TW114", f"{name} is down", take_up(bus, virtual))
    if bus.fd and int(machine.read(f"{folder}/mtu") or FD_MTU) < FD_MTU:
        raise refused(bus, "TW117", f"{name} carries no CAN FD", with_fd(bus, virtual))
    return Fitness(virtual, [] if virtual else list(controller(bus, about.get("info_data") or {})))


def link(name, machine):
    """What iproute2 knows of an interface's kind; {} where there is none."""
    try:
        links = json.loads(machine.output("ip", "-details", "-json", "link"))
    except ValueError:
        return {}
    return next((link.get("linkinfo") or {} for link in links if link.get("ifname") == name), {})


def controller(bus, data):
    """Remarks on a real controller. Refused where it is at another bitrate or bus-off."""
    name, state = bus.channel, data.get("state")
    bitrate = (data.get("bittiming") or {}).get("bitrate")
    if bitrate is not None and bitrate != bus.bitrate:
        raise refused(bus, "TW115", f"{name} runs at {bitrate} bit/s, and the rig says {bus.bitrate}", again(bus))
    if state == "BUS-OFF":
        raise refused(
            bus, "TW116", f"{name} has withdrawn from the bus after too many errors", f"{WIRING}; then: {again(bus)}"
        )
    if bitrate is None:
        yield f"{name}: its bitrate cannot be told; look at: ip -details link show {name}"
    if state in ("ERROR-WARNING", "ERROR-PASSIVE"):
        yield f"{name} is {state}: frames were lost, or nobody has acknowledged them; {WIRING}"


def refused(bus, code, message, hint):
    return Refused(Trouble(code, f"[bus.{bus.name}] {message}", hint))


def family(name):
    return name.rstrip("0123456789")


def take_up(bus, virtual=False):
    """The command that takes an interface up."""
    return f"sudo ip link set {bus.channel} up" if virtual else bring_up(bus.channel, bus.bitrate)


def again(bus):
    return f"sudo ip link set {bus.channel} down && {take_up(bus)}"


def with_fd(bus, virtual):
    change = f"mtu {FD_MTU}" if virtual else f"type can bitrate {bus.bitrate} dbitrate {DATA_BITRATE} fd on"
    return (
        f"sudo ip link set {bus.channel} down && sudo ip link set {bus.channel} {change} && sudo ip link set "
        f"{bus.channel} up"
    )


def absent(bus, machine):
    name = bus.channel
    if family(name) == "vcan":
        cure = f"sudo modprobe vcan && sudo ip link add {name} type vcan && sudo ip link set {name} up"
    else:
        cure = others(bus, machine)
    return Trouble("TW112", f"[bus.{bus.name}] there is no interface {name}", cure)


def others(bus, machine):
    """Which CAN interfaces there are instead."""
    found = [path.split("/")[-2] for path in machine.glob("sys/class/net/*/type") if machine.read(path) == ARPHRD_CAN]
    if not found:
        return (
            "this machine has no CAN interface: is the adapter plugged in, and its driver loaded? the command "
            "`doctor` looks closer"
        )
    return suggestion(bus.channel, found) or f"this machine has {', '.join(found)}"
