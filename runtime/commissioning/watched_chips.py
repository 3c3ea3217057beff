"""Sensors on an I2C bus, watched live: recognised by their registers, set up as before a run, and asked by the thread
that asks them in one.
"""

import time
from contextlib import ExitStack, closing, suppress

from blocks.families import families
from blocks.i2c import I2cDevice
from graph import Diagram
from graph.names import suggestion
from runtime.base.errors import BadInput
from runtime.commissioning.chips import chip_of
from runtime.commissioning.watched import WatchedBlocks
from runtime.diagrams.overrides import parse_like
from runtime.guardian.lock import BusLock, BusTaken
from runtime.rig.chips import KnownChips, NoAnswer, in_hex
from runtime.rig.errors import Refused
from runtime.rig.i2c import I2cInterface, SeveralRefused, error_in_words, open_adapter

HIDDEN = {"age", "errors", "mag_age", "mag_overflow", "repeated"}  # unless they are asked for
EXTENDED, TAKEN = 0x80000000, 1  # cext/abi.pxd
REST = 0.0005  # s between looks


class WatchedChips(WatchedBlocks):
    """BadInput where one is not there, is not known, or cannot be set up.

    bus : RigBus
    places : (mux, channel, address) of each, mux 0 on the bus itself; none: every one that is known
    channels : names of outputs, none for what they measure; rate : Hz, of inertial sensors
    settings : (name, text) of parameters, for each block that has one of that name
    """

    shown = ("accel", "gyro", "a0", "a1", "a2", "a3", "force", "temperature")

    def __init__(self, bus, places, channels, rate, settings=()):
        with ExitStack() as undo:
            try:
                undo.callback(BusLock(bus.interface, bus.channel).close)
                found = recognised(bus, places)
                with Diagram("stream", rate=rate) as diagram:
                    for kind, place in found:
                        block(kind, place, bus.name, parameters_of(kind, found, channels, rate, settings))
                blocks = [one for one in diagram if isinstance(one, I2cDevice)]
                refuse_strangers(blocks, channels, settings)
                super().__init__(
                    diagram,
                    lambda block: [
                        name
                        for name in block.outputs
                        if (name in channels if channels else name not in HIDDEN)
                        and not (name == "mag" and not block.magnetometer)
                    ],
                )
                self.interface = undo.enter_context(closing(I2cInterface(bus, blocks)))
            except BusTaken as taken:
                raise BadInput(f"{bus.channel} is controlled by {taken.owner}: end that one first") from None
            except SeveralRefused as refused:
                raise BadInput("\n".join(map(str, refused.troubles))) from None
            except Refused as refused:
                raise BadInput(str(refused.trouble)) from None
            self.heard = set()
            self.interface.start(0)
            self.interface.wires.begin(time.monotonic_ns())
            self.undo = undo.pop_all()

    def ask(self, patience):
        """{path of a port: its values} once something new has come and everybody has answered, None if nothing has in
        time.
        """
        deadline = time.monotonic() + patience
        while True:
            new = False
            for identifier, _, data, when in self.interface.end.receive():
                for fed in self.fed:
                    if self.feed(fed, data, when, identifier | EXTENDED).get(TAKEN):
                        new = True
                        self.heard.add(fed.block.path)
            if new and len(self.heard) == len(self.fed):
                return self.answer()
            if time.monotonic() >= deadline:
                return None
            time.sleep(REST)

    def summary(self):
        """Lines at the end."""
        lines = []
        for path, told in self.interface.counts["devices"].items():
            last = f", the last: {error_in_words(told['error'])}" if told["error"] else ""
            lines.append(f"{path}: {told['answers']} answers, {told['rate']:.1f} Hz, {told['failures']} failed{last}")
        return lines

    def close(self):
        self.undo.close()


def recognised(bus, places):
    """[(class of the block, (mux, channel, address))]. BadInput, Refused"""
    chips, _ = open_adapter(bus)
    try:
        known = KnownChips(chips)
        if not places:
            there = [((mux, channel, address), name) for mux, channel, address, name, _ in known.everywhere()]
            found = [(chip.block, place) for place, name in there if (chip := chip_of(name)) is not None]
            if not found:
                raise BadInput(
                    f"{bus.channel}: no known sensor answers; `scan --interface i2c` lists the chips that do"
                )
            return found
        return [(recognise(bus, chips, known, place), place) for place in places]
    finally:
        with suppress(NoAnswer):
            chips.leave()
        chips.close()


def recognise(bus, chips, known, place):
    """Class of the block that reads the chip at a place. BadInput"""
    mux, channel, address = place
    try:
        chips.switch(mux, channel)
        chips.probe(address)
        name, _ = known.name(address)
    except NoAnswer as error:
        who = in_hex(chips.answering(outside=error.mux))
        raise BadInput(
            f"{bus.channel}: no chip answers at "
            f"{in_words(place) if not error.mux else f'{mux:#04x}, the multiplexer'}; {who} "
            f"answer{'s' if who.count('0x') == 1 else ''} there"
        ) from None
    if (chip := chip_of(name)) is None:
        raise BadInput(
            f"{bus.channel}: the chip at {in_words(place)} is {name or 'not known here'}; shown are "
            f"{', '.join(chip_names())}"
        )
    return chip.block


def chip_names():
    """Return the names of every chip that has a block."""
    chips = [chip for family in families() for chip in family.chips if chip.block is not None]
    return [name for chip in chips for name in ([chip.name] if chip.name else chip.registers[1].values())]


def block(kind, place, bus, parameters):
    mux, channel, address = place
    name = f"{kind.__name__.lower()}_{in_words(place).replace('.', '_').replace(':', '_').replace('0x', '')}"
    try:
        return kind(bus=bus, mux=mux, channel=channel, address=address, name=name, timeout=0.0, **parameters)
    except ValueError as error:
        raise BadInput(f"{kind.kind} at {in_words(place)}: {error}") from None


def parameters_of(kind, found, channels, rate, settings):
    """Return the parameters of a block. Of several inertial sensors, each chip reads its own magnetometer: on the bus
    itself all of them would answer at one address.
    """
    given = {}
    if "magnetometer" in kind.parameters:
        given["rate"] = rate
        if channels and "mag" not in channels:
            given["magnetometer"] = False
        elif "bypass" in kind.parameters:
            given["bypass"] = sum("magnetometer" in other.parameters for other, _ in found) == 1
    if "channels" in kind.parameters and (own := tuple(name for name in channels if name in kind.channel_names)):
        given["channels"] = own
    for name, text in settings:
        if name in kind.parameters:
            given[name] = parse_like(kind.parameters[name].default, name, text)
    return given


def refuse_strangers(blocks, channels, settings):
    """BadInput where none of the blocks has what is named."""
    for what, names, there in (
        ("--channels ", channels, [name for block in blocks for name in block.outputs]),
        ("--set ", [name for name, _ in settings], [name for block in blocks for name in block.parameters]),
    ):
        stranger = next((name for name in names if name not in there), None)
        if stranger is not None:
            raise BadInput(
                f"{what}{stranger}: {suggestion(stranger, there) or 'there is ' + ', '.join(dict.fromkeys(there))}"
            )


def place_of(text):
    """(mux, channel, address) of '0x68', or behind a multiplexer '0x70.3:0x68'. BadInput"""
    where, _, address = text.rpartition(":")
    mux, _, channel = where.partition(".")
    try:
        found = (int(mux, 0), int(channel), int(address, 0)) if where else (0, 0, int(address, 0))
    except ValueError:
        found = (0, 0, 0)
    if not 0x08 <= found[2] <= 0x77 or (where and not (0x70 <= found[0] <= 0x77 and 0 <= found[1] <= 7)):
        raise BadInput(f"{text}: expected the address of a sensor, as in 0x68, or behind a multiplexer 0x70.3:0x68")
    return found


def in_words(place):
    mux, channel, address = place
    return f"{mux:#04x}.{channel}:{address:#04x}" if mux else f"{address:#04x}"
