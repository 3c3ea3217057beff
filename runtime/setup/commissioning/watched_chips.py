"""Live display of sensors on an I2C bus: identified by their registers, configured and polled as in a run."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from typing import TYPE_CHECKING, Any

from blocks.families import families
from blocks.i2c import I2cDevice
from graph import Device, Diagram
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.loading.overrides import set_block_parameters
from runtime.robot.rig.chips import KnownChips, NoAnswer, in_hex
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.i2c import I2cInterface, SeveralRefused, error_in_words, open_adapter
from runtime.setup.commissioning.chips import chip_of
from runtime.setup.commissioning.watched import WatchedBlocks

if TYPE_CHECKING:
    from runtime.robot.rig.file import RigBus

HIDDEN = {"age", "errors", "mag_age", "mag_overflow", "repeated"}  # unless selected with --channels
EXTENDED, TAKEN = 0x80000000, 1  # cext/abi.pxd
POLL_INTERVAL = 0.0005  # s between two polls


class WatchedChips(WatchedBlocks):
    """Sensors on one I2C bus.

    bus : RigBus
    places : (mux, channel, address) of each sensor, mux 0 without a multiplexer; empty for all known sensors
    channels : names of outputs; empty for the measured quantities
    rate : Hz, of inertial sensors
    settings : (name, text) of parameters, applied to each block with a parameter of that name

    Raises BadInput if a sensor does not respond, is unknown or cannot be configured.
    """

    shown = ("accel", "gyro", "a0", "a1", "a2", "a3", "force", "temperature")

    def __init__(
        self,
        bus: RigBus,
        places: Sequence[tuple[int, int, int]],
        channels: Sequence[str],
        rate: float,
        settings: Sequence[tuple[str, str]] = (),
    ) -> None:
        with ExitStack() as undo:
            try:
                undo.callback(BusLock(bus.interface, bus.channel).close)
                sensors = recognise_all(bus, places)
                with Diagram("stream", rate=rate) as diagram:
                    for kind, place in sensors:
                        _block(kind, place, bus.name, parameters_of(kind, sensors, channels, rate))
                blocks = [one for one in diagram if isinstance(one, I2cDevice)]
                refuse_unknown_names(blocks, channels, settings)
                for block in blocks:
                    own = [(name, text) for name, text in settings if name in block.parameters]
                    set_block_parameters(diagram, [(f"{block.path}.{name}", text) for name, text in own])
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
                raise BadInput(f"{bus.channel} is controlled by {taken.owner}: end that process first") from None
            except SeveralRefused as refused:
                raise BadInput("\n".join(map(str, refused.problems))) from None
            except Refused as refused:
                raise BadInput(str(refused.problem)) from None
            self.responded = set()
            self.interface.start(0)
            self.interface.wires.begin(time.monotonic_ns())
            self.undo = undo.pop_all()

    def ask(self, timeout: float) -> dict[str, list[float]] | None:
        """Return {path of a port: its values} after a new sample, once every sensor has responded.

        Returns None after `timeout` s without one.
        """
        deadline = time.monotonic() + timeout
        while True:
            new = False
            for identifier, _, data, when in self.interface.end.receive():
                for fed in self.fed:
                    if self.feed(fed, data, when, identifier | EXTENDED).get(TAKEN):
                        new = True
                        self.responded.add(fed.block.path)
            if new and len(self.responded) == len(self.fed):
                return self.answer()
            if time.monotonic() >= deadline:
                return None
            time.sleep(POLL_INTERVAL)

    def summary(self) -> list[str]:
        """Return the lines shown at the end: one per sensor."""
        lines = []
        for path, counts in self.interface.counts["devices"].items():
            last = f", last error: {error_in_words(counts['error'])}" if counts["error"] else ""
            lines.append(
                f"{path}: {counts['answers']} answers, {counts['rate']:.1f} Hz, {counts['failures']} failed{last}"
            )
        return lines

    def close(self) -> None:
        """Close the bus, and release its lock."""
        self.undo.close()


def recognise_all(bus: RigBus, places: Sequence[tuple[int, int, int]]) -> list[tuple[Any, tuple[int, int, int]]]:
    """Return [(class of the block, (mux, channel, address))]. Raises BadInput or Refused.

    places : places of the chips; empty for every known chip on the bus
    """
    chips, _ = open_adapter(bus)
    try:
        known = KnownChips(chips)
        if not places:
            named = [((mux, channel, address), name) for mux, channel, address, name, _ in known.everywhere()]
            sensors = [(chip.block, place) for place, name in named if (chip := chip_of(name)) is not None]
            if not sensors:
                raise BadInput(
                    f"{bus.channel}: no known sensor responds; `scan --interface i2c` lists the chips that do"
                )
            return sensors
        return [(recognise(bus, chips, known, place), place) for place in places]
    finally:
        with suppress(NoAnswer):
            chips.leave()
        chips.close()


def recognise(bus: RigBus, chips: Any, known: KnownChips, place: tuple[int, int, int]) -> Any:
    """Return the class of the block that reads the chip at a place. Raises BadInput if there is none.

    chips : open adapter, as returned by runtime.robot.rig.i2c.open_adapter
    """
    mux, channel, address = place
    try:
        chips.switch(mux, channel)
        chips.probe(address)
        name, _ = known.name(address)
    except NoAnswer as error:
        responding = in_hex(chips.answering(outside=error.mux))
        raise BadInput(
            f"{bus.channel}: no chip responds at "
            f"{_in_words(place) if not error.mux else f'{mux:#04x}, the multiplexer'}; "
            f"addresses that respond: {responding}"
        ) from None
    if (chip := chip_of(name)) is None:
        raise BadInput(
            f"{bus.channel}: the chip at {_in_words(place)} is {name or 'unknown'}; supported chips: "
            f"{', '.join(chip_names())}"
        )
    return chip.block


def chip_names() -> list[str]:
    """Return the names of every chip that has a block."""
    chips = [chip for family in families() for chip in family.chips if chip.block is not None]
    return [
        name
        for chip in chips
        for name in (chip.registers[1].values() if chip.registers and not chip.name else [chip.name])
    ]


def _block(kind: Any, place: tuple[int, int, int], bus: str, parameters: dict[str, Any]) -> Device:
    mux, channel, address = place
    name = f"{kind.__name__.lower()}_{_in_words(place).replace('.', '_').replace(':', '_').replace('0x', '')}"
    try:
        return kind(bus=bus, mux=mux, channel=channel, address=address, name=name, timeout=0.0, **parameters)
    except ValueError as error:
        raise BadInput(f"{kind.kind} at {_in_words(place)}: {error}") from None


def parameters_of(
    kind: Any, sensors: Sequence[tuple[Any, tuple[int, int, int]]], channels: Sequence[str], rate: float
) -> dict[str, Any]:
    """Return the parameters of a block.

    With several inertial sensors, each chip reads its magnetometer itself: on the bus, all magnetometers would have the
    same address.

    kind : class of the block
    sensors : as returned by `recognised`
    """
    given = {}
    if "magnetometer" in kind.parameters:
        given["rate"] = rate
        if channels and "mag" not in channels:
            given["magnetometer"] = False
        elif "bypass" in kind.parameters:
            given["bypass"] = sum("magnetometer" in other.parameters for other, _ in sensors) == 1
    if "channels" in kind.parameters and (own := tuple(name for name in channels if name in kind.channel_names)):
        given["channels"] = own
    return given


def refuse_unknown_names(
    blocks: Sequence[Device], channels: Sequence[str], settings: Sequence[tuple[str, str]]
) -> None:
    """Raise BadInput if a channel or setting belongs to none of the blocks."""
    for what, names, available in (
        ("--channels ", channels, [name for block in blocks for name in block.outputs]),
        ("--set ", [name for name, _ in settings], [name for block in blocks for name in block.parameters]),
    ):
        unknown = next((name for name in names if name not in available), None)
        if unknown is not None:
            raise BadInput(
                f"{what}{unknown}: "
                f"{suggestion(unknown, available) or 'available: ' + ', '.join(dict.fromkeys(available))}"
            )


def place_of(text: str) -> tuple[int, int, int]:
    """Return (mux, channel, address) of '0x68', or of '0x70.3:0x68' behind a multiplexer. Raises BadInput."""
    where, _, address = text.rpartition(":")
    mux, _, channel = where.partition(".")
    try:
        place = (int(mux, 0), int(channel), int(address, 0)) if where else (0, 0, int(address, 0))
    except ValueError:
        place = (0, 0, 0)
    if not 0x08 <= place[2] <= 0x77 or (where and not (0x70 <= place[0] <= 0x77 and 0 <= place[1] <= 7)):
        raise BadInput(f"{text}: expected the address of a sensor, as in 0x68, or behind a multiplexer 0x70.3:0x68")
    return place


def _in_words(place: tuple[int, int, int]) -> str:
    mux, channel, address = place
    return f"{mux:#04x}.{channel}:{address:#04x}" if mux else f"{address:#04x}"
