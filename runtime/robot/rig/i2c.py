"""I2C buses of a rig: opened and set up with smbus2, then handed over to a native thread.

Errors name the cause: a missing bus and how to enable it, missing permission, a missing chip and the
responding addresses.
"""

from __future__ import annotations

import errno
import os
import socket
import stat
import struct
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from blocks.i2c import I2cDevice, Read
from blocks.spi import Shift
from cext.lines.i2c import I2cBus
from cext.lines.i2c_adapters import LinuxAdapter
from cext.lines.i2c_socket import SocketAdapter
from runtime.robot.rig.chips import AdapterWires, Chips, NoAnswer, in_hex
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.file import EMULATED, EMULATED_TEXT
from runtime.robot.rig.serial_port import permission

if TYPE_CHECKING:
    from typing import Any

    from blocks.i2c import Transfer
    from cext.lines.i2c import I2cAdapter
    from runtime.robot.rig.file import RigBus


NODES = "i2c-*"  # in /dev
EXCHANGE_TIMEOUT_US = 500_000  # µs, of an emulated bus: its emulator is an ordinary process
ENABLE = (
    "Raspberry Pi: sudo raspi-config nonint do_i2c 0, which makes /dev/i2c-1; Jetson: /dev/i2c-7 (Orin) or "
    "/dev/i2c-1 is on the header, "
    "enabled by sudo /opt/nvidia/jetson-io/jetson-io.py; elsewhere: sudo modprobe i2c-dev"
)


class I2cInterface:
    """Bus with all its devices set up. Raises SeveralRefused with the problems of its devices.

    bus : RigBus
    devices : devices on the bus
    opened : return value of `open_adapter` for that bus

    wires : cext.lines.i2c.I2cBus
    virtual, remarks, strangers : as runtime.robot.rig.interface.Interface has them
    """

    virtual, strangers = False, None

    def __init__(
        self, bus: RigBus, devices: Sequence[I2cDevice], opened: tuple[Chips, I2cAdapter] | None = None
    ) -> None:
        self.bus, self.devices = bus, devices
        self.remarks = [f"[bus.{bus.name}] is {EMULATED_TEXT}"] if bus.channel.startswith(EMULATED) else []
        self.identities = {}  # values of the identity registers, to recognise a chip after a reconnect
        chips, adapter = opened or open_adapter(bus)
        problems = []
        try:
            self.wires = I2cBus(adapter, bus.name)
            for device in devices:
                self._release(device, chips)
            for device in sorted(devices, key=lambda device: (device.place, device.address)):
                try:
                    self._set_up(device, chips)
                    self._hand_over(device)
                except Refused as refused:
                    problems.append(refused.problem)
            chips.leave()
        finally:
            chips.close()
        if problems:
            raise SeveralRefused(problems)

    def _release(self, device, chips):
        """Close channels that a previous run left open. Errors are reported later."""
        try:
            chips.switch(device.mux, device.channel)
            if device.release() and not self._mismatch(device, chips):
                for write in device.release():
                    chips.write(device.address, write.register, write.data)
        except NoAnswer:
            pass

    def _mismatch(self, device, chips):
        """Return (Identity, value) if a chip identifies as another kind, else None."""
        for identity in device.identities():
            value = chips.read(device.address, identity.register, 1)[0]
            if value & identity.mask not in identity.values:
                return identity, value
        return None

    def _set_up(self, device, chips):
        """Set up a device. Raises Refused with the cause."""
        entry = f'[device."{device.path}"]'
        try:
            chips.switch(device.mux, device.channel)
            self._check_identity(device, chips, entry)
            for write in device.set_up():
                at = device.address if write.address is None else write.address
                chips.write(at, write.register, write.data)
                time.sleep(write.wait)
            self._read_settings(device, chips, entry)
        except NoAnswer as error:
            raise Refused(self._no_reply(device, chips, error, entry)) from None

    def _check_identity(self, device, chips, entry):
        """Read the identity registers of a chip. Raises Refused for another kind of chip."""
        if not device.identities():
            chips.probe(device.address)
        mismatch = self._mismatch(device, chips)
        if mismatch is not None:
            identity, value = mismatch
            expected = " or ".join(f"{value:#04x} ({name})" for value, name in identity.values.items())
            raise Refused(
                RigProblem(
                    "TW134",
                    f"{entry} {self._place_text(device)}: its identity register is {value:#04x}, "
                    f"but that of a {device.kind} is {expected}",
                    f"another chip has this address; {in_hex(chips.answering())} reply, and `python -m runtime scan` "
                    "identifies them",
                )
            )
        self.identities[device] = []
        for identity in device.identities():
            value = chips.read(device.address, identity.register, 1)[0] & identity.mask
            self.identities[device].append((identity.register, value, identity.mask))
            name = identity.values[value]
            if name != device.kind:
                self.remarks.append(f"{device.path} is a {name}")

    def _read_settings(self, device, chips, entry):
        """Read back the settings of a device. Raises Refused if they are not those that were written."""

        def read(register, count, address=None):
            return chips.read(device.address if address is None else address, register, count)

        def write(one):
            chips.write(device.address if one.address is None else one.address, one.register, one.data)
            time.sleep(one.wait)

        try:
            device.learn(read, write)
        except ValueError as error:
            raise Refused(
                RigProblem("TW129", f"{entry} {self._place_text(device)}: {error}", "see docs/reference/i2c.md")
            ) from None
        check = device.check()
        if check is not None:
            value = chips.read(device.address, check[0], len(check[1]))
            if value != check[1]:
                what = (
                    f"it was configured with {check[1].hex(' ')} and returns {value.hex(' ')} from register "
                    f"{check[0]:#04x} on"
                )
                raise Refused(
                    RigProblem(
                        "TW129",
                        f"{entry} {self._place_text(device)}: {what}",
                        "check for a long wire, missing pull-ups, two chips at one address, or a chip that only "
                        "looks like one",
                    )
                )

    def _place_text(self, device):
        """Return the channel, multiplexer and address of a device as text."""
        there = f", multiplexer {device.mux:#04x} channel {device.channel}" if device.mux else ""
        return f"{self.bus.channel}{there}, address {device.address:#04x}"

    def _no_reply(self, device, chips, error, entry):
        """Return a RigProblem that explains why a chip did not reply."""
        if error.errno == errno.EBUSY:
            return RigProblem(
                "TW135",
                f"{entry} {self._place_text(device)}: address in use by a kernel driver",
                "unload it: ls /sys/bus/i2c/devices, then sudo modprobe -r its driver, or its line in config.txt",
            )
        if error.mux:
            return RigProblem(
                "TW133",
                f"{entry} {self.bus.channel}: no multiplexer replies at {device.mux:#04x}",
                f"{in_hex(chips.answering(outside=True))} reply on the bus itself: check the mux of this device, its "
                "supply and its reset pin",
            )
        if error.errno in (errno.ETIMEDOUT, errno.EAGAIN):
            return RigProblem(
                "TW128",
                f"{entry} {self._place_text(device)}: the bus is stuck: {os.strerror(error.errno)}",
                "a device holds a line low: power-cycle the sensors; check the pull-ups, all to one voltage",
            )
        replying = in_hex(chips.answering())
        place = f"channel {device.channel} of the multiplexer {device.mux:#04x}" if device.mux else "this bus"
        what = f"at {error.address:#04x}, inside it, " if error.address != device.address else ""
        return RigProblem(
            "TW128",
            f"{entry} {self._place_text(device)}: no reply {what}({os.strerror(error.errno)})",
            f"on {place} {replying} repl{'ies' if replying.count('0x') == 1 else 'y'}: correct address, mux or channel "
            f"in {entry}, or check its supply",
        )

    def _hand_over(self, device):
        """Add a device to the native bus."""
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
            self.identities[device],
        )

    @property
    def counts(self) -> dict[str, Any]:
        """Return the counts of the thread, those of devices by path."""
        counts = self.wires.counts
        order = sorted(self.devices, key=lambda device: (device.place, device.address))
        return counts | {
            "devices": {device.path: device_counts for device, device_counts in zip(order, counts["devices"])}
        }

    end = property(lambda self: self.wires.end)

    def start(self, priority: int) -> None:
        """Start the thread that reads the devices. priority : SCHED_FIFO priority if granted, else 0"""
        self.wires.start(priority)

    def close(self) -> None:
        """End the thread, and close the bus."""
        self.wires.stop()


class SeveralRefused(Refused):
    """Several unusable devices of one bus. problems : list of RigProblem"""

    def __init__(self, problems: Sequence[RigProblem]) -> None:
        super().__init__(problems[0])
        self.problems = problems


def error_in_words(error: int) -> str:
    """Return the last error of a device as text. error : number that cext.lines.i2c counts"""
    return {-1: "it lost its settings", -2: "another kind of chip replies instead"}.get(error) or os.strerror(error)


def exchange(transfer: Transfer, address: int) -> tuple[Any, ...]:
    """Convert a transfer to the arguments of cext.lines.i2c.I2cBus.add. address : address of the device"""
    steps = tuple(
        (step.word, step.data, True)
        if isinstance(step, Shift)
        else (step.register, step.count if isinstance(step, Read) else bytes(step.data))
        for step in transfer.steps
    )
    return transfer.number, address if transfer.address is None else transfer.address, steps, bytes(transfer.appended)


def open_adapter(bus: RigBus) -> tuple[Chips, I2cAdapter]:
    """Open the bus of a RigBus. Returns (Chips, I2cAdapter). Raises Refused."""
    name = f"[bus.{bus.name}] {bus.channel}"
    if bus.channel.startswith(EMULATED):
        return open_emulated(name, bus.channel.removeprefix(EMULATED))
    try:
        if not stat.S_ISCHR(os.stat(bus.channel).st_mode):
            raise Refused(RigProblem("TW131", f"{name} is not an I2C bus", hint_of_buses()))
        from smbus2 import SMBus

        wires = SMBus(bus.channel)
    except ImportError:
        raise Refused(
            RigProblem(
                "TW119",
                f"{name}: smbus2 is not installed",
                "pip install smbus2, into the environment that this runs in",
            )
        ) from None
    except OSError as error:
        raise Refused(in_words(name, bus.channel, error)) from None
    assert wires.fd is not None
    try:
        return Chips(wires), LinuxAdapter(wires.fd)
    except OSError as error:
        wires.close()
        raise Refused(RigProblem("TW131", f"{name}: {error.strerror}", hint_of_buses())) from None


def open_emulated(name: str, path: str) -> tuple[Chips, I2cAdapter]:
    """Connect to the chips of `emulate`. Returns (Chips, SocketAdapter). Raises Refused."""
    adapter = connect_emulated(name, path)
    return Chips(AdapterWires(adapter)), adapter


def connect_emulated(name: str, path: str, duplex: bool = False) -> SocketAdapter:
    """Connect to the chips of `emulate`. Raises Refused.

    name : bus named in the message
    duplex : whether the bus is SPI
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as end:
        try:
            end.connect(path)
        except OSError as error:
            hint = "start `python -m runtime emulate` with this rig first, in another terminal"
            raise Refused(RigProblem("TW131", f"{name}: {error.strerror}", hint)) from None
        # time-out of an exchange, struct timeval
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, EXCHANGE_TIMEOUT_US))
        return SocketAdapter(end.fileno(), duplex)


def in_words(name: str, path: str, error: OSError) -> RigProblem:
    """Return a RigProblem that explains why a bus cannot be opened. name : bus named in the message"""
    if error.errno in (errno.EACCES, errno.EPERM):
        return RigProblem("TW132", f"{name}: {error.strerror}", permission(path))
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR):
        return RigProblem("TW131", f"{name}: no such bus", hint_of_buses())
    if error.errno == errno.ENOTTY:
        return RigProblem("TW131", f"{name} is not an I2C bus", hint_of_buses())
    return RigProblem("TW119", f"{name}: {error.strerror}", "see: ls -l /dev/i2c-*")


def hint_of_buses(folder: str = "/dev") -> str:
    """Return a hint that lists the I2C buses of this machine. folder : folder of the device files"""
    there = paths(folder)
    return (f"there is {', '.join(there)}; " if there else "no I2C bus is enabled; ") + ENABLE


def paths(folder: str = "/dev") -> list[str]:
    """Return the paths of all I2C buses of this machine."""
    buses = [str(path) for path in Path(folder).glob(NODES) if path.name.removeprefix("i2c-").isdigit()]
    return sorted(buses, key=lambda path: int(path.rpartition("-")[2]))
