"""Filters and mounting of a MicroStrain sensor: settings that arming writes and reads back, as dialogues.

    heading source                     0D 18; newer generation 0D 50
    complementary filter               0C 51
    sensor to vehicle                  0D 11; newer generation 0C 31
    low-pass                           0C 50; newer generation 0C 54

A setting that the block leaves to the sensor is only read, so that every recording has it. Nothing is saved in the
sensor. (MIP SDK 4.0, commands_3dm.h and commands_filter.h; data communications protocol of the 3DM-GX5-25)
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING

from blocks.imus.microstrain import mip, mounting
from blocks.imus.microstrain.descriptors import BY_NAME, SENSOR, UNTURNED, of_complementary_filter
from blocks.imus.microstrain.queries import Refusal, ask

if TYPE_CHECKING:
    from blocks.imus.microstrain.commands import Commands
    from graph.dialogue import Dialogue

HEADING, MEASUREMENT, MAGNETIC_FIELD = 0x0D18, 0x0D50, 0x8006
INVALID_PARAMETER = 3  # of an acknowledgement
NO_HEADING, MAGNETOMETER_HEADING, MAGNETOMETER_MEASUREMENT = 0, 1, 4
HEADING_SOURCES = {NO_HEADING: "none", MAGNETOMETER_HEADING: "magnetometer"}
COMPLEMENTARY = 0x0C51
TRANSFORMATION, ROTATION = 0x0C31, 0x0D11
NEW_LOW_PASS, OLD_LOW_PASS = 0x0C54, 0x0C50
FILTERED = ("accel", "gyro", "mag", "pressure")  # channels with a low-pass
SAME = 0.01  # relative difference of a cut-off or time constant that counts as equal
SAME_ANGLE = 1e-3  # rad


def heading(sensor: Commands) -> Dialogue:
    """Select the heading source of the estimation filter. Raises Rejected if it cannot use a magnetometer."""
    wanted = sensor.device.heading
    magnetic = wanted == "magnetometer"
    if magnetic and (MAGNETIC_FIELD not in sensor.known or not {HEADING, MEASUREMENT} & sensor.known):
        why = "no magnetometer" if MAGNETIC_FIELD not in sensor.known else "no command to enable one"
        sensor.refuse(
            f"its filter cannot use a magnetometer for the heading: it has {why}", 'omit `heading`, or set it to "none"'
        )
    if HEADING in sensor.known:
        if wanted:
            source = MAGNETOMETER_HEADING if magnetic else NO_HEADING
            yield from sensor.apply(
                mip.command(mip.COMMAND_FILTER, 0x18, "BB", mip.WRITE, source), "its heading source"
            )
        data = yield from sensor.read(HEADING, 0x87, required=bool(wanted))
        found = None if not data else HEADING_SOURCES.get(data[0], f"source {data[0]}")
    elif MEASUREMENT in sensor.known:
        has_source = (yield from measure(sensor, magnetic)) if wanted else True
        source = (*MAGNETOMETER_MEASUREMENT.to_bytes(2, "big"),)
        data = yield from sensor.read(MEASUREMENT, 0xD0, *source, required=magnetic)
        found = None if not data or not has_source else HEADING_SOURCES[MAGNETOMETER_HEADING * (data[-1] != 0)]
    else:
        if wanted:
            sensor.remarks.append("has no command for its heading source, which remains unchanged")
        return
    if found is not None:
        sensor.confirm("heading source", wanted in ("", found), found, wanted)


def measure(sensor: Commands, magnetic: bool) -> Dialogue:
    """Set whether the filter of the newer generation uses the magnetometer, as in MicroStrain's own examples.

    A sensor without a magnetometer rejects the source as unknown, which has the same effect as disabling it. Returns
    whether it has the source.
    """
    packet = mip.command(mip.COMMAND_FILTER, 0x50, "BHB", mip.WRITE, MAGNETOMETER_MEASUREMENT, magnetic)
    try:
        yield from ask(packet)
    except Refusal as refusal:
        if magnetic or refusal.code != INVALID_PARAMETER:
            sensor.refuse(f"its heading source: {refusal}", "select it with MicroStrain's program SensorConnect")
        return False
    sensor.messages.append(packet)
    return True


def complementary(sensor: Commands) -> Dialogue:
    """Set the corrections of the complementary filter; those that the block does not set keep their values."""
    device = sensor.device
    wanted = (device.up_compensation, device.north_compensation)
    is_set = any(constant is not None for constant in wanted)
    if COMPLEMENTARY not in sensor.known:
        if is_set:
            sensor.refuse(
                "it has no command for its complementary filter", "omit up_compensation and north_compensation"
            )
        return
    if wanted[1] and MAGNETIC_FIELD not in sensor.known:
        sensor.refuse(
            "its complementary filter cannot correct the heading: it has no magnetometer",
            "omit north_compensation, or set it to 0",
        )
    data = yield from sensor.read(COMPLEMENTARY, 0x97, required=is_set)
    if data is None:
        return
    before = list(struct.unpack(">BBff", data[:10]))
    if is_set:
        for index, constant in enumerate(wanted):
            if constant is not None:
                before[index] = constant > 0.0
                before[2 + index] = constant or before[2 + index]
        packet = mip.command(mip.COMMAND_3DM, COMPLEMENTARY & 0xFF, "BBBff", mip.WRITE, *before)
        yield from sensor.apply(packet, "its complementary filter")
        data = yield from sensor.read(COMPLEMENTARY, 0x97, required=True)
    now = struct.unpack(">BBff", data[:10])
    for index, (name, constant) in enumerate(zip(("up compensation", "north compensation"), wanted)):
        found = now[2 + index] if now[index] else 0.0
        is_so = constant is None or math.isclose(found, constant, rel_tol=SAME)
        sensor.confirm(name, is_so, correction(found), correction(constant))


def correction(constant: float | None) -> str:
    """Return a time constant in words."""
    return f"{constant:g} s" if constant else "off"


def mount(sensor: Commands) -> Dialogue:
    """Set the angles of the sensor relative to the vehicle. Raises Rejected if its attitude would not follow them."""
    wanted = sensor.device.sensor_to_vehicle
    newer = TRANSFORMATION in sensor.known
    command, reply = (TRANSFORMATION, 0xB1) if newer else (ROTATION, 0x81)
    if command not in sensor.known:
        if any(wanted):
            sensor.refuse("it has no command for sensor_to_vehicle", "omit it")
        return
    if wanted:
        angles = mounting.stored_angles(wanted, newer)
        yield from sensor.apply(
            mip.command(command >> 8, command & 0xFF, "Bfff", mip.WRITE, *angles), "its sensor-to-vehicle rotation"
        )
    data = yield from sensor.read(command, reply, required=bool(wanted))
    if data is None:
        return
    found = mounting.stored_angles(struct.unpack(">fff", data[:12]), newer)
    is_so = not wanted or mounting.between(found, wanted) < SAME_ANGLE
    sensor.confirm("sensor to vehicle", is_so, in_degrees(found), in_degrees(wanted))
    if mounting.between(found, (0.0, 0.0, 0.0)) < SAME_ANGLE:
        return
    if not wanted:
        sensor.remarks.append(f"reports in axes turned by the rotation stored in it: {in_degrees(found)}")
    if not newer and of_complementary_filter(sensor.device.fields):
        sensor.refuse(f"its rotation, {in_degrees(found)}, {UNTURNED[0]}", UNTURNED[1])


def in_degrees(angles: tuple[float, ...]) -> str:
    """Return roll, pitch and yaw in words."""
    return f"roll, pitch, yaw {', '.join(f'{round(math.degrees(angle), 2) + 0.0:g}' for angle in angles)}°"


def low_pass(sensor: Commands) -> Dialogue:
    """Set the low-pass of the requested channels that have one."""
    device = sensor.device
    is_set = device.low_pass > 0.0 or bool(device.anti_aliasing)
    newer = NEW_LOW_PASS in sensor.known
    if not newer and OLD_LOW_PASS not in sensor.known:
        if is_set:
            sensor.refuse("it has no command for its low-pass", "omit low_pass and anti_aliasing")
        return
    command, reply = (NEW_LOW_PASS, 0xD4) if newer else (OLD_LOW_PASS, 0x8B)
    for name in FILTERED:
        field = BY_NAME[name]
        if not sensor.has(field) or field not in device.fields:
            continue
        selector = (SENSOR, field.descriptor) if newer else (field.descriptor,)
        wanted = (device.anti_aliasing != "off", device.low_pass > 0.0)  # enabled, manual
        if is_set:
            cutoff = struct.pack(">f", device.low_pass) if newer else struct.pack(">HB", round(device.low_pass), 0)
            packet = mip.packet(mip.COMMAND_3DM, (command & 0xFF, bytes((mip.WRITE, *selector, *wanted)) + cutoff))
            yield from sensor.apply(packet, f"the low-pass of {name}")
        data = yield from sensor.read(command, reply, *selector, required=is_set)
        if data is None:
            continue
        enabled, manual, found = struct.unpack_from(">BBf" if newer else ">BBH", data, len(selector))
        is_so = not is_set or (
            (bool(enabled), bool(manual)) == (wanted if wanted[0] else (False, bool(manual)))
            and (not wanted[1] or math.isclose(found, device.low_pass, rel_tol=SAME, abs_tol=0.5))
        )
        sensor.confirm(
            f"low-pass of {name}", is_so, pass_band(enabled, manual, found), pass_band(*wanted, device.low_pass)
        )


def pass_band(enabled: bool, manual: bool, cutoff: float) -> str:
    """Return a low-pass in words."""
    return "off" if not enabled else f"{cutoff:g} Hz" if manual else "half the sample rate"


SETTINGS: tuple[Callable[[Commands], Dialogue], ...] = (heading, complementary, mount, low_pass)
