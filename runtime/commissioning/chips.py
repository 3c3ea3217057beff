"""The chips on an I2C bus, and behind every multiplexer on it: each address is probed as by i2cdetect, and registers
that identify a chip are read.
"""

from dataclasses import dataclass

from blocks.families import families
from runtime.commissioning.scan import Report
from runtime.guardian.lock import BusLock, BusTaken
from runtime.rig.chips import KnownChips
from runtime.rig.errors import Refused, Trouble
from runtime.rig.i2c import open_adapter


def chip_of(name):
    """Return the graph.family.Chip with a block that has this name, None without one."""
    chips = [chip for family in families() for chip in family.chips if chip.block is not None]
    return next(
        (chip for chip in chips if name == chip.name or chip.registers and name in chip.registers[1].values()), None
    )


NOBODY = (
    "no chip answers: is the sensors' supply on, SDA to SDA, SCL to SCL, a pull-up to each? on a Raspberry Pi pins 3 "
    "and 5 are bus 1"
)


@dataclass(frozen=True)
class Chip:
    """mux, channel : 0 on the bus itself; name : "" where it is not known; how : what tells that; block : that reads
    it, "" for none
    """

    mux: int
    channel: int
    address: int
    name: str
    how: str
    block: str

    @property
    def path(self):
        """A name for the device in a rig."""
        return f"{self.block}_{self.mux:x}_{self.channel}" if self.mux else f"{self.block}_{self.address:x}"

    @property
    def where(self):
        return f"{self.mux:#04x}.{self.channel} {self.address:#04x}" if self.mux else f"{self.address:#04x}"


def look(bus, opened=None):
    """The Report of a bus. Refused

    bus : RigBus; opened : as runtime.rig.i2c.open_adapter returns it
    """
    try:
        lock = BusLock(bus.interface, bus.channel)
    except BusTaken as taken:
        raise Refused(
            Trouble(
                "TW106",
                f"[bus.{bus.name}] {bus.channel} is controlled by {taken.owner}",
                "end that one first: it has its multiplexers in its hands",
            )
        ) from None
    try:
        chips, _ = opened or open_adapter(bus)
        try:
            found = KnownChips(chips).everywhere()
        finally:
            chips.close()
    finally:
        lock.close()
    report = Report(bus.name, bus.interface, bus.channel, 0)
    report.chips = [
        Chip(mux, channel, address, name, how, kind.rig_name if (kind := chip_of(name)) else "")
        for mux, channel, address, name, how in found
    ]
    if not report.chips:
        report.remarks.append(NOBODY)
    return report
