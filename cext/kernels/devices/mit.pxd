"""MIT mode, which the boards of several vendors speak: 64 bits of a command, p16 v12 kp12 kd12 t12, most significant bit first.

`wire` has half the range of each, in this order. The items are those of blocks.actuators.joint.Joint.
"""

from libc.math cimport copysign, fabs, isfinite
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport AUTHORITY, INPUTS, NOT_FINITE, OK, OUTPUTS, OUT_OF_LIMITS, PARAMETERS, PERIOD, Frame
from cext.kernels.devices.drive_law cimport Known, Law, keep_inside
from cext.kernels.devices.fields cimport from_code, to_code, to_code_inward

cdef enum:
    POSITION_COMMAND, VELOCITY_COMMAND, TORQUE_COMMAND, STIFFNESS_COMMAND, DAMPING_COMMAND
    POSITION, VELOCITY, TORQUE, TEMPERATURE, FAULT, AGE, TORQUE_SENT, LIMITED
    CAN_ID, INVERT, OFFSET, TIMEOUT, GEAR_RATIO, WIRE_POSITION, WIRE_VELOCITY, WIRE_STIFFNESS, WIRE_DAMPING, WIRE_TORQUE
    MAX_ACCELERATION
    OWN                         # first parameter of a family

cdef struct Codes:              # of a command
    uint32_t position
    uint32_t velocity
    uint32_t stiffness
    uint32_t damping
    uint32_t torque


cdef inline int memory_of(const int32_t *slots) noexcept nogil:
    """The item that is WIRE. LIMITS follows: of the five commands, of the drive's whole law, and the share of stiffness and damping allowed.
    Then SENT: position, velocity, stiffness, damping and torque of the last frame.
    """
    return slots[INPUTS] + slots[OUTPUTS] + slots[PARAMETERS]


cdef inline void pack(uint8_t *data, uint32_t p, uint32_t v, uint32_t kp, uint32_t kd, uint32_t t) noexcept nogil:
    data[0] = <uint8_t>(p >> 8)
    data[1] = <uint8_t>p
    data[2] = <uint8_t>(v >> 4)
    data[3] = <uint8_t>((v & 15) << 4 | kp >> 8)
    data[4] = <uint8_t>kp
    data[5] = <uint8_t>(kd >> 4)
    data[6] = <uint8_t>((kd & 15) << 4 | t >> 8)
    data[7] = <uint8_t>t


cdef inline void unpack(const uint8_t *data, const double *wire, double *command) noexcept nogil:
    command[0] = from_code(<uint32_t>data[0] << 8 | data[1], -wire[0], wire[0], 16)
    command[1] = from_code(<uint32_t>data[2] << 4 | data[3] >> 4, -wire[1], wire[1], 12)
    command[2] = from_code((<uint32_t>data[3] & 15) << 8 | data[4], 0.0, wire[2], 12)
    command[3] = from_code(<uint32_t>data[5] << 4 | data[6] >> 4, 0.0, wire[3], 12)
    command[4] = from_code((<uint32_t>data[6] & 15) << 8 | data[7], -wire[4], wire[4], 12)


cdef inline bint all_ones(const uint8_t *data, int count) noexcept nogil:
    cdef int i
    for i in range(count):
        if data[i] != 0xFF:
            return False
    return True


cdef inline bint limit_law(
        double *arena, const int32_t *slots, int more, double position_step, double velocity_step, Law *law) noexcept nogil:
    """Keep a law that has stiffness or damping inside its limit. Returns whether it was changed."""
    cdef int memory = memory_of(slots)
    cdef double *wire = arena + slots[memory]
    cdef double *limits = arena + slots[memory + 1]
    cdef Known known
    known.position, known.velocity, known.age = arena[slots[POSITION]], arena[slots[VELOCITY]], arena[slots[AGE]]
    known.period, known.acceleration, known.gains = arena[PERIOD], arena[slots[MAX_ACCELERATION + more]], limits[6]
    known.offset, known.position_end, known.velocity_end = arena[slots[OFFSET + more]], wire[0], wire[1]
    known.position_step, known.velocity_step = position_step, velocity_step
    known.stiffness_step, known.damping_step = wire[2] / 0xFFF, wire[3] / 0xFFF
    return keep_inside(law, &known, limits[5])


cdef inline int quantise(
        double *arena, const int32_t *slots, int more, double position_step, double velocity_step, Codes *codes) noexcept nogil:
    """The codes of a tick's command, and what of it is sent. OK, or why there are none.

    more : outputs that the family has behind LIMITED: its parameters stand so much further behind
    position_step, velocity_step : what one code means, of the command or of the feedback, whichever is coarser
    """
    cdef int memory = memory_of(slots)
    cdef double *wire = arena + slots[memory]
    cdef double *limits = arena + slots[memory + 1]
    cdef double *sent = arena + slots[memory + 2]
    cdef double sign = -1.0 if arena[slots[INVERT + more]] != 0.0 else 1.0
    cdef double share = arena[AUTHORITY]
    cdef Law law
    cdef bint limited
    law.position, law.velocity, law.torque = (
        arena[slots[POSITION_COMMAND]], arena[slots[VELOCITY_COMMAND]], arena[slots[TORQUE_COMMAND]])
    law.stiffness, law.damping = arena[slots[STIFFNESS_COMMAND]], arena[slots[DAMPING_COMMAND]]
    if not (isfinite(law.position) and isfinite(law.velocity) and isfinite(law.stiffness) and isfinite(law.damping)
            and isfinite(law.torque)):
        return NOT_FINITE
    if (not -limits[0] <= law.position <= limits[0] or not -limits[1] <= law.velocity <= limits[1]
            or not 0.0 <= law.stiffness <= limits[2] or not 0.0 <= law.damping <= limits[3] or not -limits[4] <= law.torque <= limits[4]):
        return OUT_OF_LIMITS
    if not (0.0 <= share <= 1.0 and limits[5] >= 0.0):
        return OUT_OF_LIMITS    # with NaN it would be full torque
    limited = fabs(law.torque) > limits[5]
    if limited:
        law.torque = copysign(limits[5], law.torque)
    if law.stiffness > 0.0 or law.damping > 0.0:
        limited |= limit_law(arena, slots, more, position_step, velocity_step, &law)
    arena[slots[LIMITED]] += limited
    codes.position = to_code(sign * (law.position + arena[slots[OFFSET + more]]), -wire[0], wire[0], 16)
    codes.velocity = to_code(sign * law.velocity, -wire[1], wire[1], 12)
    codes.stiffness = to_code(share * law.stiffness, 0.0, wire[2], 12)
    codes.damping = to_code(share * law.damping, 0.0, wire[3], 12)
    law.torque *= sign * share
    codes.torque = to_code_inward(law.torque, wire[4], 12) if limited else to_code(law.torque, -wire[4], wire[4], 12)
    sent[0] = sign * from_code(codes.position, -wire[0], wire[0], 16) - arena[slots[OFFSET + more]]
    sent[1] = sign * from_code(codes.velocity, -wire[1], wire[1], 12)
    sent[2] = from_code(codes.stiffness, 0.0, wire[2], 12)
    sent[3] = from_code(codes.damping, 0.0, wire[3], 12)
    sent[4] = arena[slots[TORQUE_SENT]] = sign * from_code(codes.torque, -wire[4], wire[4], 12)
    return OK


cdef inline int encode_command(double *arena, const int32_t *slots, Frame *frame) noexcept nogil:
    """The one frame of a tick, to the drive's id; or below zero, why there is none."""
    cdef double *wire = arena + slots[memory_of(slots)]
    cdef Codes codes
    cdef int status = quantise(arena, slots, 0, 2.0 * wire[0] / 0xFFFF, 2.0 * wire[1] / 0xFFF, &codes)
    if status != OK:
        return -status
    memset(frame, 0, sizeof(Frame))
    frame.id = <uint32_t>arena[slots[CAN_ID]]
    frame.length = 8
    pack(frame.data, codes.position, codes.velocity, codes.stiffness, codes.damping, codes.torque)
    return 1


cdef inline void decode_motion(double *arena, const int32_t *slots, const uint8_t *data) noexcept nogil:
    """p16 v12 t12 of a reply, behind the id of the drive."""
    cdef double *wire = arena + slots[memory_of(slots)]
    cdef double sign = -1.0 if arena[slots[INVERT]] != 0.0 else 1.0
    arena[slots[POSITION]] = sign * from_code(<uint32_t>data[1] << 8 | data[2], -wire[0], wire[0], 16) - arena[slots[OFFSET]]
    arena[slots[VELOCITY]] = sign * from_code(<uint32_t>data[3] << 4 | data[4] >> 4, -wire[1], wire[1], 12)
    arena[slots[TORQUE]] = sign * from_code((<uint32_t>data[4] & 15) << 8 | data[5], -wire[4], wire[4], 12)


cdef inline void pack_motion(
        uint8_t *data, uint32_t id, const double *wire, double position, double velocity, double torque) noexcept nogil:
    """The first six bytes of a reply."""
    cdef uint32_t p = to_code(position, -wire[0], wire[0], 16)
    cdef uint32_t v = to_code(velocity, -wire[1], wire[1], 12)
    cdef uint32_t t = to_code(torque, -wire[4], wire[4], 12)
    data[0] = <uint8_t>id
    data[1] = <uint8_t>(p >> 8)
    data[2] = <uint8_t>p
    data[3] = <uint8_t>(v >> 4)
    data[4] = <uint8_t>((v & 15) << 4 | t >> 8)
    data[5] = <uint8_t>t
