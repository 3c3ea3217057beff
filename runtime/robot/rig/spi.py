"""SPI buses of a rig: every chip is read once, then handed over to a native thread."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cext.lines.i2c import I2cBus
from cext.lines.spi import SpiAdapter
from runtime.robot.rig.errors import RigProblem
from runtime.robot.rig.file import EMULATED, EMULATED_TEXT
from runtime.robot.rig.i2c import I2cInterface, SeveralRefused, connect_emulated, exchange
from runtime.robot.rig.serial_port import permission

if TYPE_CHECKING:
    from blocks.spi import SpiDevice
    from cext.lines.i2c import I2cAdapter
    from runtime.robot.rig.bus import RigBus

ATTEMPTS, PAUSE = 5, 0.01  # of a first valid reply; s between two. The first reply may belong to an earlier command
ENABLE = (
    "Raspberry Pi: sudo raspi-config nonint do_spi 0, which makes /dev/spidev0.0 and /dev/spidev0.1; Jetson: "
    "sudo /opt/nvidia/jetson-io/jetson-io.py"
)


class SpiInterface(I2cInterface):
    """Bus whose devices all reply. Raises SeveralRefused with the problems of its devices.

    bus : RigBus
    devices : devices on the bus
    opened : adapter for that bus, None to open it
    """

    def __init__(self, bus: RigBus, devices: Sequence[SpiDevice], opened: I2cAdapter | None = None) -> None:
        self.bus, self.devices = bus, devices
        self.remarks = [f"[bus.{bus.name}] is {EMULATED_TEXT}"] if bus.channel.startswith(EMULATED) else []
        problems = []
        adapter = opened or open_adapter(bus, devices)
        self.wires = I2cBus(adapter, bus.name, "spi")
        for device in sorted(devices, key=lambda device: device.address):
            problems += _problems(bus, device, adapter)
            self.wires.add(
                0,
                device.address,
                rounds=tuple(
                    (one.period, one.settle, tuple(exchange(transfer, device.address) for transfer in one.transfers))
                    for one in device.rounds()
                ),
            )
        if problems:
            raise SeveralRefused(problems)


def _problems(bus, device, adapter):
    """Return the RigProblem of a device without a valid reply, in a list."""
    step, problem = device.rounds()[0].transfers[0].steps[0], ""
    for _ in range(ATTEMPTS):
        try:
            problem = device.problem(adapter.shift(device.address, step.word, step.data))
        except OSError as error:
            problem = f"the transfer failed: {error.strerror}"
        if not problem:
            return []
        time.sleep(PAUSE)
    return [
        RigProblem(
            "TW128",
            f'[device."{device.path}"] {bus.channel}, chip select {device.address}: no valid reply of a {device.kind}: '
            f"{problem}",
            f"check its supply, MISO and chip_select, or write a lower bitrate in [bus.{bus.name}]",
        )
    ]


def open_adapter(bus: RigBus, devices: Sequence[SpiDevice]) -> I2cAdapter:
    """Open the chip selects of a bus. Returns an I2cAdapter. Raises SeveralRefused."""
    if bus.channel.startswith(EMULATED):
        return connect_emulated(f"[bus.{bus.name}] {bus.channel}", bus.channel.removeprefix(EMULATED), duplex=True)
    adapter, problems = SpiAdapter(bus.bitrate), []
    for device in devices:
        path = f"{bus.channel}.{device.chip_select}"
        try:
            file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
            try:
                adapter.add(device.chip_select, file, device.mode)
            finally:
                os.close(file)
        except OSError as error:
            problems.append(in_words(f"[bus.{bus.name}] {path}", path, error))
    if problems:
        raise SeveralRefused(list(dict.fromkeys(problems)))
    return adapter


def in_words(name: str, path: str, error: OSError) -> RigProblem:
    """Return a RigProblem that explains why a chip select cannot be opened. name : bus named in the message"""
    if error.errno in (errno.EACCES, errno.EPERM):
        return RigProblem("TW132", f"{name}: {error.strerror}", permission(path))
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR):
        return RigProblem("TW131", f"{name}: no such chip select", hint_of_buses())
    if error.errno in (errno.ENOTTY, errno.EISDIR):
        return RigProblem("TW131", f"{name} is not an SPI bus", hint_of_buses())
    return RigProblem("TW119", f"{name}: {error.strerror}", "see: ls -l /dev/spidev*")


def hint_of_buses(folder: str = "/dev") -> str:
    """Return a hint that lists the chip selects of this machine. folder : folder of the device files"""
    there = sorted(str(path) for path in Path(folder).glob("spidev*.*"))
    return (f"there is {', '.join(there)}; " if there else "no SPI bus is enabled; ") + ENABLE
