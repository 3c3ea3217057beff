"""Checks of a compile: commands, addresses and heat of devices, and the load of buses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from graph import hints
from graph.budget import bus_loads, line_loads, spi_loads
from graph.compilation import Compilation
from graph.device import Actuator, Device, actuators_of
from graph.names import suggestion
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.block import Block


def apply_caps(compilation: Compilation) -> None:
    """Take the caps of the diagram, and let each block know its own: below a torque, it may do more than it must.

    If a setting differs from the table of its model, the cap holds for either: the drive may give `factor` times what
    is commanded and measured.
    """
    given = compilation.diagram.caps
    for path in given.keys() - {block.path for block in actuators_of(compilation.blocks)}:
        compilation.report("TW036", f"{given[path].source} has caps for {path!r}, which is not an actuator")
    for block in compilation.blocks:
        if isinstance(block, Actuator):
            caps = given.get(block.path)
            if caps is not None:
                found = compilation.attempt(block, block.deviations) or ()
                factor = max([1.0, *(each.factor for each in found if each.factor is not None)])
                caps = compilation.caps[block] = replace(caps, torque=caps.torque / factor)
            if caps != block.caps:
                block.caps = caps
                compilation.attempt(block, block.configure)


def check_caps(compilation: Compilation) -> None:
    """Report the caps that cannot hold, because nothing that Tickwork sends or measures bounds the quantity."""
    for block, caps in compilation.caps.items():
        watch, stop = compilation.attempt(block, block.watched), compilation.attempt(block, block.damped_stop)
        bound = compilation.torque_bounds.get(block.path)
        reasons: list[str] = []
        if caps.torque < math.inf or caps.power < math.inf:
            if bound is None or bound.kind in ("drive", "none"):
                reasons.append("nothing that it sends bounds its torque: command a torque or a current")
            elif watch is None or watch.law_limit is None:
                reasons.append("its watched() names no law_limit, from which its kernel reads the torque that remains")
            reasons += [
                f"{deviation.parameter}: {deviation.effect}. Correct it"
                for deviation in compilation.attempt(block, block.deviations) or ()
                if deviation.factor is None and not deviation.safe
            ]
            if stop is not None and stop.limit > caps.torque * (1.0 + 1e-9):
                reasons.append(f"its safe stop damps within {stop.limit:.4g} N·m: lower the current or the damping")
        if (watch is None or watch.motion is None) and (caps.range or min(caps.speed, caps.power) < math.inf):
            reasons.append("its watched() has no motion, so nothing measures its angle and speed")
        elif watch is not None:
            try:
                caps.of_watch(watch)
            except ValueError as error:
                reasons.append(str(error))
        for reason in reasons:
            compilation.report("TW036", f"the caps of {caps.source} cannot hold: {reason}", block)


def check_actuators(compilation: Compilation) -> None:
    """Report actuators without a connected command."""
    for block in compilation.blocks:
        if (
            isinstance(block, Actuator)
            and block.inputs
            and not any((block, n) in compilation.wires for n in block.inputs)
        ):
            compilation.report(
                "TW005",
                f"none of its commands is connected ({', '.join(block.inputs)})",
                block,
                hint=hints.for_assignment(block)
                or f"connect one, as in {block.path.split('/')[-1]}({hints.usual_command(block)}=...), or "
                "remove the actuator",
            )


def check_effects(compilation: Compilation) -> None:
    """Warn of a position or velocity command whose gain, the stiffness or the damping, is 0."""
    for block in compilation.blocks:
        if not isinstance(block, Actuator):
            continue
        for name, gain in (("position_command", "stiffness_command"), ("velocity_command", "damping_command")):
            if gain in block.inputs and is_zero(compilation, block, gain) and not is_zero(compilation, block, name):
                compilation.report(
                    "TW027",
                    f"the command has no effect, because {gain} is 0",
                    block,
                    name,
                    compilation.where(block, name),
                    f"connect it, as in {block.path.split('/')[-1]}({name}=..., {gain}=...)",
                    "warning",
                )


def is_zero(compilation: Compilation, block: Block, name: str) -> bool:
    """Return whether an input is the constant 0."""
    source = compilation.sources.get((block, name))
    return source is not None and not isinstance(source, Signal) and not np.any(source)


def check_heat(compilation: Compilation) -> None:
    """Check that each actuator reports its temperature or has a thermal model."""
    modelled = {
        source.block
        for block in compilation.blocks
        if block.models_heat
        for name in block.inputs
        if isinstance(source := compilation.sources.get((block, name)), Signal)
    }
    for block in compilation.blocks:
        if isinstance(block, Actuator) and "temperature" not in block.outputs and block not in modelled:
            compilation.report(
                "TW024",
                "the actuator reports no temperature and has no thermal model",
                block,
                hint="connect a ThermalModel to its torque, and limit the command with a TemperatureDerating",
                severity="warning",
            )


def check_relays(compilation: Compilation) -> None:
    """Check that the diagram has the actuators and buses that a relay powers."""
    actuators = actuators_of(compilation.blocks)
    known = {name for block in actuators for name in (block.path, block.bus)}
    for block in compilation.devices:
        for name in sorted(set(block.protects) - known):
            compilation.report(
                "TW010",
                f"protects: the diagram has no actuator and no bus of actuators named {name!r}",
                block,
                hint=suggestion(name, known) or f"name one of {', '.join(sorted(known))}"
                if known
                else "add an actuator, or remove the block",
            )


def check_timeouts(compilation: Compilation) -> None:
    """Report devices whose timeout is shorter than two ticks."""
    for block in compilation.devices:
        if 0.0 < block.timeout < 2.0 / compilation.diagram.rate:
            compilation.report(
                "TW010",
                f"timeout: {block.timeout:g} s is shorter than two ticks at "
                f"{compilation.diagram.rate:g} Hz, so every run would time out",
                block,
                hint=f"set timeout={2.0 / compilation.diagram.rate:.3g} or more, or 0 to disable it",
            )


def check_addresses(compilation: Compilation) -> None:
    """Report devices with the same address on one bus."""
    taken: dict[tuple[str, object], Device] = {}
    for block in compilation.devices:
        for address in block.addresses():
            other = taken.setdefault((block.bus, address), block)
            if other is not block:
                what = block.address_in_words(address)
                compilation.report(
                    "TW013",
                    f"shares {what} on bus {block.bus!r} with {other.path}, made at {other.location}",
                    block,
                    hint=block.address_hint,
                )
                break


def check_bitrates(compilation: Compilation) -> None:
    """Check that all devices on a CAN bus that declare a bitrate have the same one."""
    devices = [block for block in compilation.devices if isinstance(block, Actuator) or "bitrate" in block.parameters]
    for block in devices:
        other = next((other for other in devices if other.bus == block.bus and other.bitrate > block.bitrate), None)
        if other is not None:
            compilation.report(
                "TW025",
                f"is set to {block.bitrate / 1e3:g} kbit/s, but {other.path} on the same bus {block.bus!r} to "
                f"{other.bitrate / 1e3:g} kbit/s",
                block,
                hint=f"connect it to a separate bus, or set the device to {other.bitrate / 1e3:g} kbit/s and "
                f"pass bitrate={other.bitrate:.0f}",
            )


def check_lines(compilation: Compilation) -> None:
    """Check that a bus has one medium, and a stream one device."""
    first: dict[str, Device] = {}
    for block in compilation.devices:
        other = first.setdefault(block.bus, block)
        if other is not block and (block.medium != other.medium or block.medium == "stream"):
            what = (
                "a separate line"
                if block.medium == other.medium
                else f"an interface of kind {block.medium}, but {other.path} uses {other.medium}"
            )
            compilation.report(
                "TW013",
                f"is on bus {block.bus!r} with {other.path}, made at {other.location}, and needs {what}",
                block,
                hint="set a different `bus`, or omit it: the default is the path of the block",
            )


def check_buses(compilation: Compilation) -> None:
    """Compute the load of each bus and serial line, and report overloaded ones."""
    compilation.loads = [*bus_loads(compilation.devices, compilation.diagram.rate), *spi_loads(compilation.devices)]
    for load in compilation.loads:
        there = [block for block in compilation.devices if block.bus == load.bus]
        what = (
            f"{load.frames:g} frames per second use {load.typical:.0%} of bus {load.bus!r} at "
            f"{load.bitrate / 1e6:g} Mbit/s, {load.worst:.0%} in the worst case"
        )
        hint = f"lower the rate, or move some of its {len(there)} devices to another bus"
        if load.typical > 1.0:
            compilation.report("TW016", what, there[0], hint=hint)
        elif load.worst > 0.7:
            compilation.report("TW022", what, there[0], hint=hint, severity="warning")
    check_line_speeds(compilation)


def check_line_speeds(compilation: Compilation) -> None:
    """Report serial lines that cannot carry the messages of their device, or only just."""
    for load in line_loads(compilation.devices):
        what = (
            f"{load.messages:g} messages per second, at least {load.bytes:g} bytes, use {load.share:.0%} of "
            f"its line at {load.speed:g} bit/s"
        )
        hint = "lower its rate, request fewer channels, or raise the baud rate of the device and `baudrate`"
        if load.share > 1.0:
            compilation.report("TW016", what, load.device, hint=hint)
        elif load.share > 0.8:
            compilation.report("TW022", what, load.device, hint=hint, severity="warning")
