"""Frames of moteus controllers: CAN FD, registers in subframes. (mjbots/moteus, docs/protocol.)

    command     0x8000 | id     the drive replies to host 0
    reply       id << 8

    01 00 mode | 08 06 20 position velocity torque kp kd limit (int32) | 05 27 time-out in ms (int16)
    02 28 FF FF no limits of velocity and acceleration | 01 2B 00 no integral term | QUERY
    reply to QUERY: 28 04 00 mode position velocity torque (int32) | 23 0D voltage temperature fault (int8)

Units of int32: 10⁻⁵ revolutions, 10⁻⁵ revolutions/s, 10⁻³ N·m, 1/(2³¹ - 1) of kp and kd; of int8: 0.5 V and 1 °C. A
value that a command does not have is the drive's default, so each command has all of them. Frames are padded with 50
(no operation) to a length of CAN FD, and above eight bytes, since shorter ones are sent as classic CAN.
"""

from __future__ import annotations

import math
import struct

from graph.dialogue import Frame
from graph.family import Answer

FAMILY = "moteus"
STOPPED, FAULT, POSITION, TIMEOUT = 0, 1, 10, 11  # of register 0, mode
QUERY = bytes([0x18, 4, 0, 0x13, 0x0D])
HEAD, TAIL = b"\x28\x04\x00", b"\x23\x0d"
REPLY = struct.Struct("<3s4i2s3b")
NOT_SET = -(2**31)  # the value that a register does not have; of a position command: where the joint is
LENGTHS = (12, 16, 20, 24, 32, 48, 64)
FAULTS = {
    32: "calibration",
    33: "motor driver",
    34: "over-voltage",
    35: "encoder: no magnet is seen",
    36: "motor not calibrated: moteus_tool --calibrate",
    37: "PWM cycle overrun",
    38: "over-temperature",
    39: "outside servopos.position_min and position_max",
    40: "under-voltage",
    41: "configuration changed during operation",
    42: "no valid commutation encoder",
    43: "no valid output encoder",
    44: "gate driver not enabled",
    45: "stop position with limits of velocity or acceleration",
    46: "timing violation",
    47: "bemf_feedforward without a limit of acceleration",
    48: "servopos limits outside the position's range",
    TIMEOUT: "it has received no command for its time-out, and damps the joint (servo.timeout_mode)",
}


def frame(can_id: int, data: bytes) -> Frame:
    """Return a command frame, padded."""
    return 0x8000 | can_id, True, data.ljust(next(each for each in LENGTHS if each >= len(data)), b"\x50")


def query(can_id: int) -> Frame:
    """Return the frame that requests the state and commands nothing."""
    return frame(can_id, QUERY)


def stop(can_id: int) -> Frame:
    """Return the frame that stops the drive, which clears a fault, and requests its state."""
    return frame(can_id, bytes([1, 0, STOPPED]) + QUERY)


def set_zero(can_id: int) -> Frame:
    """Return the frame that makes the present position zero, until power-off."""
    return frame(can_id, b"\x0d\xb1\x02" + struct.pack("<f", 0.0) + QUERY)


def nothing(can_id: int, timeout: int) -> Frame:
    """Return the frame that enables position mode without gains, torque or permitted torque. timeout : ms"""
    values = struct.pack("<6ih", NOT_SET, 0, 0, 0, 0, 0, timeout)
    writes = b"\x01\x00\x0a\x08\x06\x20" + values[:24] + b"\x05\x27" + values[24:] + b"\x02\x28\xff\xff\x01\x2b\x00"
    return frame(can_id, writes + QUERY)


def fault_of(mode: int, fault: int) -> int:
    """Return the code of the block's output `fault`; 0 for none."""
    return fault if mode == FAULT else 0 if mode in (STOPPED, 2, 3, 4, POSITION) else mode


def in_words(code: int) -> str:
    """Return the text of a code of `fault_of`."""
    return FAULTS.get(code, f"mode {code}: another program commands it" if code < 32 else f"fault {code}, not listed")


def state(identifier: int, extended: bool, data: bytes, can_id: int) -> Answer | None:
    """Return the Answer of a reply to QUERY, None for another frame."""
    if identifier != can_id << 8 or len(data) < REPLY.size:
        return None
    head, mode, position, velocity, torque, tail, voltage, temperature, fault = REPLY.unpack(data[: REPLY.size])
    if (head, tail) != (HEAD, TAIL) or NOT_SET in (position, velocity, torque):
        return None
    code = fault_of(mode, fault)
    return Answer(
        FAMILY,
        can_id,
        2e-5 * math.pi * position,
        2e-5 * math.pi * velocity,
        1e-3 * torque,
        temperature=float(temperature),
        voltage=0.5 * voltage,
        fault=in_words(code) if code else "",
        enabled=mode not in (STOPPED, FAULT),
        block="Moteus",
    )
