"""The buses of a robot on its rig: opened before a run, asked afterwards what happened on them."""

import errno
import os
from dataclasses import dataclass

from cext.socketcan import SocketCan
from graph import Device
from runtime.doctor.machine import Machine
from runtime.rig.file import SOCKETCAN
from runtime.rig.fitness import WIRING, again, take_up
from runtime.rig.interface import Interface
from runtime.rig.troubles import Refused, RigError, Trouble

PATIENCE = 10                   # ticks in a row with a full queue, then it is a fault
GONE = (errno.ENODEV, errno.ENXIO)


@dataclass
class OpenBus:
    interface: Interface
    can: SocketCan


class RigBuses:
    """The interfaces behind the buses of a robot, open. RigError with everything that keeps one from it.

    rig : RigFile
    robot : Diagram, as the rig has it
    names : of the buses, in the schedule's order
    """

    def __init__(self, rig, robot, names, machine=None):
        self.rig, self.buses, troubles = rig, {}, []
        devices = [block for block in robot if isinstance(block, Device)]
        for name in names:
            try:
                self.buses[name] = self.open(name, [block for block in devices if block.bus == name], machine or Machine())
            except Refused as refused:
                troubles.append(refused.trouble)
        if troubles:
            self.close()
            raise RigError(rig.path, dict.fromkeys(troubles))

    def open(self, name, devices, machine):
        bus = self.rig.buses[name]
        if bus.interface != SOCKETCAN:
            raise Refused(Trouble(
                "TW105", f"[bus.{name}] interface = {bus.interface!r}: a robot runs over socketcan alone",
                "most adapters have a SocketCAN driver: candleLight (gs_usb), slcan (sudo slcand -o -s8 /dev/ttyACM0 can0), PEAK, Kvaser"))
        heard = [device.hears() for device in devices]
        listens = None if None in heard else sorted({pattern for patterns in heard for pattern in patterns})
        interface = Interface(bus, listens, sorted({address for device in devices for address in device.addresses()}), machine)
        return OpenBus(interface, SocketCan(interface.socket, fd=bus.fd, shared=interface.virtual, patience=PATIENCE))

    def ends(self):
        """The robot's end of each bus, in the schedule's order."""
        return [bus.can.end for bus in self.buses.values()]

    def remarks(self):
        """Lines that a person should read before the run."""
        return [f"{self.rig.path}: {remark}" for bus in self.buses.values() for remark in bus.interface.remarks]

    def close(self):
        for bus in self.buses.values():
            bus.interface.close()

    def finish(self):
        """Ask what happened, and close. Returns {bus: its counts, state and strangers} as plain data."""
        self.after = {name: self.count(bus) for name, bus in self.buses.items()}
        self.close()
        return self.after

    def count(self, bus):
        strangers, ids = bus.interface.strangers.heard() if bus.interface.strangers is not None else (0, [])
        return {
            "interface": bus.interface.bus.interface, "channel": bus.interface.bus.channel, **bus.can.counts, "strangers": strangers,
            "stranger_ids": ids, "worst_state": bus.can.worst}

    def correct(self, frames):
        """Frames as a run's statistics count them, with what did not reach the robot: {kind: number}. To be asked after `finish`."""
        kinds = ("errors", "strangers", "refused", "echoes", "corrupt", "overflows")
        total = {kind: sum(bus[kind] for bus in self.after.values()) for kind in kinds}
        strangers = total.pop("strangers")
        corrected = frames | total
        corrected["received"] += strangers - total["errors"]
        corrected["foreign"] += strangers - total["errors"]
        return corrected

    def strangers(self):
        """Ids of frames for nobody here, by bus."""
        return {name: bus["stranger_ids"] for name, bus in self.after.items() if bus["stranger_ids"]}

    def unheard(self):
        """Channels on which nobody has acknowledged our frames."""
        return [bus["channel"] for bus in self.after.values() if bus["worst_state"] in ("passive", "off") or bus["refused"]]

    def explain(self, name):
        """Why a bus failed, and the cure: two lines."""
        return in_words(self.buses[name].can.trouble, self.buses[name].interface.bus, self.buses[name].interface.virtual)


def in_words(trouble, bus, virtual):
    """A SocketCan's trouble, and its cure.

    bus : RigBus
    virtual : whether it is on one machine
    """
    channel = bus.channel
    if trouble == "bus-off":
        return f"{channel} is bus-off: its controller has withdrawn after too many errors", f"{WIRING}; then: {again(bus)}"
    if trouble == "full":
        return (f"the queue of {channel} was full for {PATIENCE} ticks: nobody acknowledges its frames, or they are more than it carries",
                f"{WIRING}; room for more: sudo ip link set {channel} txqueuelen 128")
    if trouble == errno.ENETDOWN:
        return f"{channel} was taken down", take_up(bus, virtual)
    if trouble in GONE:
        return f"{channel} is gone: its adapter was unplugged, or lost its supply", f"plug it in, then: {take_up(bus, virtual)}"
    said = os.strerror(trouble) if trouble else "a frame went neither in nor out"
    return f"{channel}: {said}", f"look at: ip -details -statistics link show {channel}"
