"""Frames of Damiao drives in MIT mode, on standard identifiers.

    command     id           p16 v12 kp12 kd12 t12, most significant bit first
    special     id           FF FF FF FF FF FF FF x: FC enable, FD disable, FE set the zero here, FB clear the error
    register    0x7FF        id (16 bits), 33 read, 55 write or AA store all, register, value; little-endian
    state       MST_ID       status << 4 | id & 15, p16 v12 t12, temperatures of the MOSFETs and of the rotor in °C
    reply       MST_ID       id (16 bits), 33, 55 or AA, register, value

The drive answers each of these with its state, and a register frame with a reply. `CC` in place of 33 requests the
state without a command. A state with status 0 and the position code 0x0033, 0x0055 or 0x00AA looks like a reply: the
lowest 0.07 rad of the range are taken for one. Facts of the manuals of the DM-J series, and of the public clients
damiao-motor 1.0.6 and lerobot 0.4.4, which agree.
"""

from __future__ import annotations

import struct

from blocks.actuators.queries import symmetric
from graph.dialogue import Frame
from graph.family import Answer

BROADCAST = 0x7FF
READ, WRITE, STORE, REFRESH = 0x33, 0x55, 0xAA, 0xCC
CLEAR = b"\xff\xff\xff\xff\xff\xff\xff\xfb"
MIT = 1  # of CTRL_MODE: position and velocity 2, velocity 3, position and torque 4
TIMEOUT_COUNTS = 20000  # of TIMEOUT, a second
REGISTERS = {  # name: index
    **{name: index for index, name in enumerate("UV_Value KT_Value OT_Value OC_Value ACC DEC MAX_SPD".split())},
    **{name: 7 + index for index, name in enumerate("MST_ID ESC_ID TIMEOUT CTRL_MODE Damp Inertia hw_ver".split())},
    **{name: 14 + index for index, name in enumerate("sw_ver SN NPP Rs Ls Flux Gr PMAX VMAX TMAX I_BW".split())},
    **{name: 25 + index for index, name in enumerate("KP_ASR KI_ASR KP_APR KI_APR OV_Value GREF Deta".split())},
    **{name: 32 + index for index, name in enumerate("V_BW IQ_c1 VL_c1 can_br sub_ver".split())},
    "p_m": 80,
    "xout": 81,
}
NAMES = {index: name for name, index in REGISTERS.items()}
MST_ID, ESC_ID, TIMEOUT, CTRL_MODE, PMAX, VMAX, TMAX = 7, 8, 9, 10, 21, 22, 23
WHOLE = {7, 8, 9, 10, 13, 14, 15, 16, 35, 36}  # the others are floats
WRITABLE = {*range(11), *range(21, 36)}
STATUS = {
    8: "over-voltage",
    9: "under-voltage",
    10: "over-current",
    11: "MOSFETs too hot",
    12: "rotor too hot",
    13: "communication lost: it has received no command for its TIMEOUT",
    14: "overload",
}
FAMILY = "Damiao"


def layout(index: int) -> str:
    """Return the struct format of a register's value."""
    return "<I" if index in WHOLE else "<f"


def read(index: int, can_id: int) -> Frame:
    """Return the frame that reads a register."""
    return BROADCAST, False, struct.pack("<HBBI", can_id, READ, index, 0)


def write(index: int, value: float, can_id: int) -> Frame:
    """Return the frame that writes a register, kept until power-off. Raises struct.error for a value out of range."""
    number = int(value) if index in WHOLE else float(value)
    return BROADCAST, False, struct.pack("<HBB", can_id, WRITE, index) + struct.pack(layout(index), number)


def store(can_id: int) -> Frame:
    """Return the frame that stores all registers; the drive must be disabled."""
    return BROADCAST, False, struct.pack("<HBBI", can_id, STORE, 1, 0)


def refresh(can_id: int) -> Frame:
    """Return the frame that requests the state and commands nothing."""
    return BROADCAST, False, struct.pack("<HBBI", can_id, REFRESH, 0, 0)


def is_register(data: bytes) -> bool:
    """Return whether the data of a frame from MST_ID are a reply of a register, not a state."""
    return len(data) == 8 and data[0] < 16 and data[1] == 0 and data[2] in (READ, WRITE, STORE) and data[3] <= 81


def register(
    identifier: int, extended: bool, data: bytes, can_id: int, index: int, kind: int = READ
) -> tuple[int, float] | None:
    """Return (MST_ID, value) of the reply of a register, None for another frame."""
    if extended or identifier == BROADCAST or not is_register(data) or data[0] != can_id:
        return None
    return (identifier, struct.unpack_from(layout(index), data, 4)[0]) if data[2:4] == bytes([kind, index]) else None


def state(
    identifier: int, extended: bool, data: bytes, can_id: int, master_id: int | None = None, model=None
) -> Answer | None:
    """Return the Answer of a state, None for another frame. Velocity and torque need the model.

    master_id : id from which the drive replies, any other than its own if None
    """
    replies = identifier not in (can_id, BROADCAST) if master_id is None else identifier == master_id
    if extended or not replies or len(data) != 8 or data[0] & 15 != can_id or is_register(data):
        return None
    status = data[0] >> 4
    if status not in (0, 1, *STATUS):
        return None
    answer = Answer(FAMILY, can_id, block="Damiao", settings={"master_id": identifier}, enabled=status == 1)
    answer.temperature = float(max(data[6:8]))
    answer.fault = STATUS.get(status, "")
    if model is not None:
        answer.position = symmetric(data[1] << 8 | data[2], model.wire_position, 16)
        answer.velocity = symmetric(data[3] << 4 | data[4] >> 4, model.wire_velocity, 12)
        answer.torque = symmetric((data[4] & 15) << 8 | data[5], model.wire_torque, 12)
    return answer
