"""I2C buses of a rig: opened with smbus2, every chip asked what it is and set up, then handed over to a native thread.

What cannot be is told in words: no such bus and how to have one, no permission, nobody at an address and who answers
instead.
"""

import errno
import os
import stat
import time
from pathlib import Path

from cext.lines.i2c import I2cBus
from cext.lines.i2c_adapters import LinuxAdapter
from runtime.rig.chips import Chips, NoAnswer, in_hex
from runtime.rig.errors import Refused, Trouble
from runtime.rig.serial_port import permission

NODES = "i2c-*"  # in /dev
ENABLE = (
    "Raspberry Pi: sudo raspi-config nonint do_i2c 0, which makes /dev/i2c-1; Jetson: /dev/i2c-7 (Orin) or "
    "/dev/i2c-1 is on the header, "
    "enabled by sudo /opt/nvidia/jetson-io/jetson-io.py; elsewhere: sudo modprobe i2c-dev"
)


class I2cInterface:
    """A bus of which every device has been set up.

    bus : RigBus; devices : blocks.i2c.I2cDevice that are on it
    opened : as `open_adapter` returns it, of that bus

    wires : cext.lines.i2c.I2cBus
    virtual, remarks, strangers : as runtime.rig.interface.Interface has them
    """

    virtual, strangers = False, None

    def __init__(self, bus, devices, opened=None):
        self.bus, self.devices, self.remarks = bus, devices, []
        self.said = {}  # what each says that it is, by which it is known when it was lost and is back
        chips, adapter = opened or open_adapter(bus)
        troubles = []
        try:
            self.wires = I2cBus(adapter, bus.name)
            for device in devices:
                self.release(device, chips)
            for device in sorted(devices, key=lambda device: (device.place, device.address)):
                try:
                    self.set_up(device, chips)
                    self.hand_over(device)
                except Refused as refused:
                    troubles.append(refused.trouble)
            chips.leave()
        finally:
            chips.close()
        if troubles:
            raise SeveralRefused(troubles)

    def release(self, device, chips):
        """What a run before has left open is closed. Whether it is there at all is told later."""
        try:
            chips.switch(device.mux, device.channel)
            if device.release() and not self.strange(device, chips):
                for write in device.release():
                    chips.write(device.address, write.register, write.data)
        except NoAnswer:
            pass

    def strange(self, device, chips):
        """(Identity, what it says) where a chip says that it is another; None where it is the one."""
        for identity in device.identities():
            said = chips.read(device.address, identity.register, 1)[0]
            if said & identity.mask not in identity.values:
                return identity, said
        return None

    def set_up(self, device, chips):
        """Refused, with the cause in words."""
        who = f'[device."{device.path}"]'
        try:
            chips.switch(device.mux, device.channel)
            self.recognise(device, chips, who)
            for write in device.set_up():
                at = device.address if write.address is None else write.address
                chips.write(at, write.register, write.data)
                time.sleep(write.wait)
            self.learn(device, chips, who)
        except NoAnswer as error:
            raise Refused(self.nobody(device, chips, error, who)) from None

    def recognise(self, device, chips, who):
        if not device.identities():
            chips.probe(device.address)
        found = self.strange(device, chips)
        if found is not None:
            identity, said = found
            wanted = " or ".join(f"{value:#04x} ({name})" for value, name in identity.values.items())
            raise Refused(
                Trouble(
                    "TW134",
                    f"{who} {self.where(device)}: it says {said:#04x}, and a {device.kind} says {wanted}",
                    f"another chip has this address: {in_hex(chips.answering())} answer; `python -m runtime scan` "
                    "tells "
                    "what they are",
                )
            )
        self.said[device] = []
        for identity in device.identities():
            said = chips.read(device.address, identity.register, 1)[0] & identity.mask
            self.said[device].append((identity.register, said, identity.mask))
            name = identity.values[said]
            if name != device.kind:
                self.remarks.append(f"{device.path} is a {name}")

    def learn(self, device, chips, who):
        def read(register, count, address=None):
            return chips.read(device.address if address is None else address, register, count)

        def write(one):
            chips.write(device.address if one.address is None else one.address, one.register, one.data)
            time.sleep(one.wait)

        try:
            device.learn(read, write)
        except ValueError as error:
            raise Refused(
                Trouble("TW129", f"{who} {self.where(device)}: {error}", "docs/sensors.md tells of its set-up")
            ) from None
        check = device.check()
        if check is not None:
            said = chips.read(device.address, check[0], len(check[1]))
            if said != check[1]:
                what = f"it was told {check[1].hex(' ')} and says {said.hex(' ')} from register {check[0]:#04x} on"
                raise Refused(
                    Trouble(
                        "TW129",
                        f"{who} {self.where(device)}: {what}",
                        "a wire that is too long or without pull-ups, two chips at one address, or a chip that only "
                        "looks like one",
                    )
                )

    def where(self, device):
        there = f", multiplexer {device.mux:#04x} channel {device.channel}" if device.mux else ""
        return f"{self.bus.channel}{there}, address {device.address:#04x}"

    def nobody(self, device, chips, error, who):
        """Why a chip did not answer, as a Trouble."""
        if error.errno == errno.EBUSY:
            return Trouble(
                "TW135",
                f"{who} {self.where(device)}: a driver of the kernel has this address",
                "take it away: ls /sys/bus/i2c/devices, then sudo modprobe -r its driver, or its line in config.txt",
            )
        if error.mux:
            return Trouble(
                "TW133",
                f"{who} {self.bus.channel}: no multiplexer answers at {device.mux:#04x}",
                f"{in_hex(chips.answering(outside=True))} answer on the bus itself: the mux of this device, its "
                "supply, or its reset pin",
            )
        if error.errno in (errno.ETIMEDOUT, errno.EAGAIN):
            return Trouble(
                "TW128",
                f"{who} {self.where(device)}: the bus hangs: {os.strerror(error.errno)}",
                "a device holds a line low: take the supply of the sensors away and give it back; are there "
                "pull-ups, to one voltage?",
            )
        found = in_hex(chips.answering())
        place = f"channel {device.channel} of the multiplexer {device.mux:#04x}" if device.mux else "this bus"
        what = f"at {error.address:#04x}, inside it, " if error.address != device.address else ""
        return Trouble(
            "TW128",
            f"{who} {self.where(device)}: nobody answers {what}({os.strerror(error.errno)})",
            f"on {place} {found} answer{'s' if found.count('0x') == 1 else ''}: write address, mux or channel in "
            f"{who}; or its supply",
        )

    def hand_over(self, device):
        at = device.address
        check = device.check()
        self.wires.add(
            device.place,
            at,
            tuple((at if w.address is None else w.address, w.register, bytes(w.data), w.wait) for w in device.set_up()),
            check,
            tuple(
                (one.period, one.settle, tuple(exchange(transfer, at) for transfer in one.transfers))
                for one in device.rounds()
            ),
            self.said[device],
        )

    @property
    def counts(self):
        """What the thread has counted, its devices by path."""
        counts = self.wires.counts
        order = sorted(self.devices, key=lambda device: (device.place, device.address))
        return counts | {"devices": {device.path: told for device, told in zip(order, counts["devices"])}}

    end = property(lambda self: self.wires.end)

    def start(self, priority):
        self.wires.start(priority)

    def close(self):
        self.wires.stop()


class SeveralRefused(Refused):
    """Several devices of one bus cannot be. troubles : of each"""

    def __init__(self, troubles):
        super().__init__(troubles[0])
        self.troubles = troubles


def error_in_words(error):
    """Why a device failed last, as cext.lines.i2c counts it."""
    return {-1: "it had lost its settings", -2: "another kind of chip answers in its place"}.get(error) or os.strerror(
        error
    )


def exchange(transfer, address):
    """As cext.lines.i2c.I2cBus.add takes it."""
    steps = tuple(
        (step.register, step.count if hasattr(step, "count") else bytes(step.data)) for step in transfer.steps
    )
    return transfer.number, address if transfer.address is None else transfer.address, steps, bytes(transfer.appended)


def open_adapter(bus):
    """(Chips, LinuxAdapter) of a RigBus. Refused"""
    name = f"[bus.{bus.name}] {bus.channel}"
    try:
        if not stat.S_ISCHR(os.stat(bus.channel).st_mode):
            raise Refused(Trouble("TW131", f"{name} is no I2C bus", known()))
        from smbus2 import SMBus

        wires = SMBus(bus.channel)
    except ImportError:
        raise Refused(
            Trouble(
                "TW119",
                f"{name}: smbus2 is not installed",
                "pip install smbus2, into the environment that this runs in",
            )
        ) from None
    except OSError as error:
        raise Refused(in_words(name, bus.channel, error)) from None
    try:
        return Chips(wires), LinuxAdapter(wires.fd)
    except OSError as error:
        wires.close()
        raise Refused(Trouble("TW131", f"{name}: {error.strerror}", known())) from None


def in_words(name, path, error):
    """Why a bus cannot be opened, as a Trouble."""
    if error.errno in (errno.EACCES, errno.EPERM):
        return Trouble("TW132", f"{name}: {error.strerror}", permission(path))
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR):
        return Trouble("TW131", f"{name}: there is no such bus", known())
    if error.errno == errno.ENOTTY:
        return Trouble("TW131", f"{name} is no I2C bus", known())
    return Trouble("TW119", f"{name}: {error.strerror}", "look at: ls -l /dev/i2c-*")


def known(folder="/dev"):
    there = paths(folder)
    return (f"there is {', '.join(there)}; " if there else "this machine has no I2C bus that is enabled; ") + ENABLE


def paths(folder="/dev"):
    """Every I2C bus of this machine."""
    found = [str(path) for path in Path(folder).glob(NODES) if path.name.removeprefix("i2c-").isdigit()]
    return sorted(found, key=lambda path: int(path.rpartition("-")[2]))
