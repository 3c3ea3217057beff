"""Scan of an I2C bus and of every multiplexer on it.

Each address is probed as by i2cdetect. Identification registers name the chip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from blocks.families import families
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.rig.chips import KnownChips
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.i2c import open_adapter
from runtime.setup.commissioning.scan import Report

if TYPE_CHECKING:
    from graph import family
    from runtime.robot.rig.file import RigBus


def chip_of(name: str) -> family.Chip | None:
    """Return the graph.family.Chip with a block that has this name, None without one."""
    chips = [chip for family in families() for chip in family.chips if chip.block is not None]
    return next(
        (chip for chip in chips if name == chip.name or chip.registers and name in chip.registers[1].values()), None
    )


NO_CHIP_HINT = (
    "no chip responds: check the sensors' supply, the wiring (SDA to SDA, SCL to SCL) and the pull-up resistors of "
    "both lines. On a Raspberry Pi, pins 3 and 5 are bus 1"
)


@dataclass(frozen=True)
class Chip:
    """Chip that responds on an I2C bus.

    mux, channel : address and channel of the multiplexer, 0 without one
    name : "" if unknown
    how : register that identifies the chip
    block : prefix of the device's name in a rig file, "" without a block that reads the chip
    """

    mux: int
    channel: int
    address: int
    name: str
    how: str
    block: str

    @property
    def path(self) -> str:
        """Name for the device in a rig file."""
        return f"{self.block}_{self.mux:x}_{self.channel}" if self.mux else f"{self.block}_{self.address:x}"

    @property
    def where(self) -> str:
        """Address in hexadecimal, behind a multiplexer with its address and channel: '0x70.3 0x68'."""
        return f"{self.mux:#04x}.{self.channel} {self.address:#04x}" if self.mux else f"{self.address:#04x}"


def look(bus: RigBus, opened: Any = None) -> Report:
    """Return the Report of a bus. Raises Refused if the bus cannot be opened.

    bus : RigBus; opened : result of runtime.robot.rig.i2c.open_adapter, or None to open the adapter here
    """
    try:
        lock = BusLock(bus.interface, bus.channel)
    except BusTaken as taken:
        raise Refused(
            RigProblem(
                "TW106",
                f"[bus.{bus.name}] {bus.channel} is controlled by {taken.owner}",
                "end that process first: it switches the multiplexers of the bus",
            )
        ) from None
    try:
        chips, _ = opened or open_adapter(bus)
        try:
            rows = KnownChips(chips).everywhere()
        finally:
            chips.close()
    finally:
        lock.close()
    report = Report(bus.name, bus.interface, bus.channel, 0)
    report.chips = [
        Chip(mux, channel, address, name, how, kind.rig_name if (kind := chip_of(name)) else "")
        for mux, channel, address, name, how in rows
    ]
    if not report.chips:
        report.remarks.append(NO_CHIP_HINT)
    return report
