"""Frames of the RobStride private protocol, as (arbitration id, is extended, data), and the meaning of their bits.

RobStride user manuals of 2026-04-28, section 4.1; CyberGear manual, section 4.1.
"""

import struct
from collections.abc import Sequence
from typing import Any

OPERATION, FEEDBACK, ENABLE, STOP, SET_ZERO, READ, WRITE, REPORT_FAULTS, REPORT = 1, 2, 3, 4, 6, 17, 18, 21, 24  # types
MODE_BITS = 3 << 22  # of the identifier of FEEDBACK and REPORT: 0 for a drive that is not enabled
GET_ID, SET_ID, SAVE, PROTOCOL = 0, 7, 22, 25  # of configuration; a CyberGear interprets 22 as its baud rate
READ_IN_MIT_MODE, WRITE_IN_MIT_MODE = 0x300, 0x400  # with the id of a drive
NEWCOMER = 0xFE  # target of the answer to GET_ID

MECH_POS, MECH_VEL = 0x7019, 0x701B  # measured, which arming compares with the replies
RUN_MODE, IQ_REF, SPD_REF, LIMIT_TORQUE = 0x7005, 0x7006, 0x700A, 0x700B
LOC_REF, LIMIT_SPD, LIMIT_CUR, ACC_RAD, VEL_MAX, ACC_SET, CAN_TIMEOUT = (
    0x7016,
    0x7017,
    0x7018,
    0x7022,
    0x7024,
    0x7025,
    0x7028,
)
WHOLE = {RUN_MODE: "<Bxxx", 0x7026: "<Hxx", CAN_TIMEOUT: "<I", 0x7029: "<Bxxx"}  # the others are floats
WHOLE_OF_CYBERGEAR = {0x701D: "<hxx"}
NAMES = {
    RUN_MODE: "run_mode",
    IQ_REF: "iq_ref",
    LIMIT_TORQUE: "limit_torque",
    LIMIT_SPD: "limit_spd",
    LIMIT_CUR: "limit_cur",
    ACC_RAD: "acc_rad",
    VEL_MAX: "vel_max",
    ACC_SET: "acc_set",
    CAN_TIMEOUT: "canTimeout",
}
TIMEOUT_COUNTS = 20000  # of CAN_TIMEOUT, a second

# The output `fault`: six bits of the feedback, one of this library, and from bit 8 on the 32 of a fault report.
FAULTS = {
    0: "under-voltage",
    1: "over-current or driver",
    2: "over-temperature",
    3: "magnetic encoder",
    4: "stalled or overloaded",
    5: "not calibrated",
    6: "has stopped by itself",
    7: "a setting differs from the one written",
    8: "motor too hot",
    9: "driver chip",
    10: "under-voltage",
    11: "over-voltage",
    12: "current of phase B",
    13: "current of phase C",
    15: "encoder not calibrated",
    16: "hardware identification",
    17: "position at the start",
    22: "stalled",
    24: "current of phase A",
}
DIFFERENT = 1 << 7  # then the bits of the fault report are the value that was read, and its place follows
REPORTED = 8  # where the fault report begins
PLACE = 40
UNREADABLE = 0xFFFFFFFF  # in place of that value
SETTINGS_LIMIT = 8  # of cext/kernels/devices/robstride/settings.pxd, as the types below
TYPES = {"<f": 0, "<Bxxx": 1, "<Hxx": 2, "<I": 4}
FAULTS_OF_CYBERGEAR = FAULTS | {4: "Hall sensor", **dict.fromkeys(range(16, 24), "overloaded")}


def frame(kind: int, field: int, can_id: int, data: bytes = bytes(8)) -> tuple[int, bool, bytes]:
    """field : the sixteen bits in the middle of the identifier, mostly the host's id"""
    return kind << 24 | field << 8 | can_id, True, bytes(data)


def write(index: int, value: float, can_id: int, host_id: int) -> tuple[int, bool, bytes]:
    """Return the frame that writes a parameter, kept until power-off."""
    return frame(WRITE, host_id, can_id, struct.pack("<HH", index, 0) + struct.pack(WHOLE.get(index, "<f"), value))


def read(index: int, can_id: int, host_id: int) -> tuple[int, bool, bytes]:
    """Return the frame that reads a parameter. index : index of the parameter"""
    return frame(READ, host_id, can_id, struct.pack("<Hxxxxxx", index))


def read_in_mit_mode(index: int, can_id: int) -> tuple[int, bool, bytes]:
    """Return the frame that reads a parameter in the MIT protocol. index : index of the parameter"""
    return READ_IN_MIT_MODE | can_id, False, struct.pack("<Hxxxxxx", index)


def settings_of(written: Sequence[tuple[int, float]]) -> tuple[float, ...]:
    """Return the memory `settings` of a driver. written : (index, value) of each setting, in the order of the reads"""
    kinds = [TYPES[WHOLE.get(index, "<f")] for index, _ in written]
    values = [
        float(number) for (index, value), kind in zip(written, kinds) for number in (index, kind, single(value, kind))
    ]
    return (float(len(written)), *values, *[0.0] * (3 * (SETTINGS_LIMIT - len(written))))


def single(value: float, kind: int) -> float:
    """Return a value as the drive stores it. kind : one of TYPES"""
    return value if kind else struct.unpack("<f", struct.pack("<f", value))[0]


def difference(written: Sequence[tuple[int, float]], place: int, bits: int) -> str:
    """Return how a setting that was read back differs.

    written : as in `settings_of`; place : position of the setting, from 1; bits : raw value that was read
    """
    if not 1 <= place <= len(written):
        return "a setting differs from the one written"
    index, value = written[place - 1]
    name = f"{NAMES.get(index, 'parameter')} (0x{index:04X})"
    if bits == UNREADABLE:
        return f"{name} cannot be read back, {value:g} was written"
    layout = WHOLE.get(index, "<f")
    return f"{name} reads {struct.unpack_from(layout, bits.to_bytes(4, 'little'))[0]:g}, {value:g} was written"


COMPARED = {9: ("position", MECH_POS, "mechPos"), 10: ("velocity", MECH_VEL, "mechVel")}  # PLACE of settings.pxd


def compared_in_words(indices: Sequence[int]) -> str:
    """Return the measurements that arming compares with parameters, for the table before arming. indices : of those"""
    names = [quantity for quantity, index, _ in COMPARED.values() if index in indices]
    return f"{' and '.join(names)} compared with its parameters" if names else ""


def disagreement(block: Any, place: int, bits: int) -> str:
    """Return how the replies of a drive differ from one of its parameters, and the ranges that correct it.

    place, bits : as in `difference`; bits are the ratio of the reply to the parameter
    """
    quantity, index, name = COMPARED[place]
    ratio = struct.unpack("<f", bits.to_bytes(4, "little"))[0]
    number = 0 if quantity == "position" else 1
    text = f"the {quantity} in its replies is {ratio:.2g} times its parameter {name} (0x{index:04X})"
    if not 0.1 < ratio < 10.0:
        return f"{text}: check its firmware, and whether another program sets its zero"
    own = block.wire[number] * block.gear_ratio / ratio
    fits = [each.name for each in getattr(block.spec, "range_sets", ()) if abs(each.values[number] / own - 1.0) < 0.05]
    cure = f"ranges = {fits[0]!r}" if len(fits) == 1 else f"wire_{quantity} = {own:.3g}"
    return f"{text}: its firmware has other ranges than the table of {block.spec.name}. Set {cure}"


def set_zero(can_id: int, host_id: int) -> tuple[int, bool, bytes]:
    """Return the frame that makes the present position of the drive its zero."""
    return frame(SET_ZERO, host_id, can_id, bytes([1]).ljust(8, b"\0"))


def timeout_counts(seconds: float) -> int:
    """Return the value of CAN_TIMEOUT, at least 1 for a time above 0."""
    return max(round(seconds * TIMEOUT_COUNTS), int(seconds > 0.0))


def reports(on: bool, can_id: int, host_id: int) -> tuple[int, bool, bytes]:
    """Return the frame that turns periodic reports every 10 ms on or off."""
    return frame(REPORT, host_id, can_id, bytes([1, 2, 3, 4, 5, 6, int(on), 8]))


def meanings(is_cybergear: bool) -> dict[int, str]:
    """Return {bit: text} of the faults."""
    return FAULTS_OF_CYBERGEAR if is_cybergear else FAULTS


def names(fault: float, meanings: dict[int, str] = FAULTS) -> list[str]:
    """Return the names of the bits of `fault`."""
    return [meanings.get(bit, bit_in_words(bit)) for bit in range(40) if int(fault) >> bit & 1]


def word_in_words(fault: int) -> str:
    """Return the names of the bits of a word of 32 faults."""
    return ", ".join(warning_in_words(bit) for bit in range(32) if int(fault) >> bit & 1)


def in_words(fault: int, meanings: dict[int, str] = FAULTS) -> str:
    """Return the names with the bits, as in 'over-voltage (bit 3 of the fault report)'; '' for none."""
    return ", ".join(
        f"{meanings[bit]} ({bit_in_words(bit)})" if bit in meanings else bit_in_words(bit)
        for bit in range(40)
        if int(fault) >> bit & 1
    )


def bit_in_words(bit: int) -> str:
    """Return the name of a fault bit whose meaning is unknown."""
    return f"bit {bit}" if bit < REPORTED else f"bit {bit - REPORTED} of the fault report"


def warning_in_words(bit: int, meanings: dict[int, str] = FAULTS) -> str:
    """Return the name of a bit of the second word of a fault report, whose bits are those of the first."""
    name = meanings.get(REPORTED + bit)
    return f"{name} (bit {bit})" if name else f"bit {bit}"
