"""MIT mode, which boards of several vendors support.

A command has 64 bits: p16 v12 kp12 kd12 t12, most significant bit first. `wire` contains half the range of each, in
this order.
"""

from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport AUTHORITY, OK, PERIOD, Frame
from cext.kernels.devices.drive_law cimport Known, Law, accept, keep_inside, know_times
from cext.kernels.devices.fields cimport from_code, to_code, to_code_inward

cdef struct Mit:                # items of blocks.actuators.joint.Joint; each family's struct contains it
    int32_t position_command, velocity_command, torque_command, stiffness_command, damping_command
    int32_t position, velocity, torque, temperature, fault, age, torque_sent, limited
    int32_t can_id, invert, offset, max_acceleration, max_transit
    int32_t transit             # s, the longest measured, and what the age of the feedback does not contain
    int32_t wire                # position, velocity, stiffness, damping, torque: half ranges at the joint
    # limits of the five commands and of the drive's whole law; permitted fraction of stiffness and damping
    int32_t limits
    int32_t sent                # position, velocity, stiffness, damping and torque of the last frame

cdef inline str mit_sizes(): return "transit[3] wire[5] limits[7] sent[5]"

cdef struct Codes:              # codes of a command
    uint32_t position
    uint32_t velocity
    uint32_t stiffness
    uint32_t damping
    uint32_t torque


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
        double *arena, const Mit *at, double position_step, double velocity_step, Law *law) noexcept nogil:
    """Limit a law with stiffness or damping. Returns whether it was changed."""
    cdef double *wire = arena + at.wire
    cdef double *limits = arena + at.limits
    cdef Known known
    know_times(&known, arena[at.age], arena[PERIOD], arena[at.max_transit], arena + at.transit)
    known.position, known.velocity = arena[at.position], arena[at.velocity]
    known.acceleration, known.gains = arena[at.max_acceleration], limits[6]
    known.offset, known.position_end, known.velocity_end = arena[at.offset], wire[0], wire[1]
    known.position_step, known.velocity_step = position_step, velocity_step
    known.stiffness_step, known.damping_step = wire[2] / 0xFFF, wire[3] / 0xFFF
    known.share = arena[AUTHORITY]
    return keep_inside(law, &known, limits[5])


cdef inline int quantise(
        double *arena, const Mit *at, double position_step, double velocity_step, Codes *codes) noexcept nogil:
    """Compute the codes of a tick's command, and the values they represent. Returns OK or the reason for rejection.

    position_step, velocity_step : size of one code, of the command or of the feedback, whichever is coarser
    """
    cdef double *wire = arena + at.wire
    cdef double *limits = arena + at.limits
    cdef double *sent = arena + at.sent
    cdef double sign = -1.0 if arena[at.invert] != 0.0 else 1.0
    cdef double share = arena[AUTHORITY]
    cdef Law law
    cdef bint limited
    cdef int status
    law.position, law.velocity, law.torque = (
        arena[at.position_command], arena[at.velocity_command], arena[at.torque_command])
    law.stiffness, law.damping = arena[at.stiffness_command], arena[at.damping_command]
    status = accept(&law, limits, share, &limited)
    if status != OK:
        return status
    if share > 0.0 and (law.stiffness > 0.0 or law.damping > 0.0):
        limited |= limit_law(arena, at, position_step, velocity_step, &law)
    arena[at.limited] += limited
    codes.position = to_code(sign * (law.position + arena[at.offset]), -wire[0], wire[0], 16)
    codes.velocity = to_code(sign * law.velocity, -wire[1], wire[1], 12)
    codes.stiffness = to_code(share * law.stiffness, 0.0, wire[2], 12)
    codes.damping = to_code(share * law.damping, 0.0, wire[3], 12)
    law.torque *= sign * share
    codes.torque = to_code_inward(law.torque, wire[4], 12) if limited else to_code(law.torque, -wire[4], wire[4], 12)
    sent[0] = sign * from_code(codes.position, -wire[0], wire[0], 16) - arena[at.offset]
    sent[1] = sign * from_code(codes.velocity, -wire[1], wire[1], 12)
    sent[2] = from_code(codes.stiffness, 0.0, wire[2], 12)
    sent[3] = from_code(codes.damping, 0.0, wire[3], 12)
    sent[4] = arena[at.torque_sent] = sign * from_code(codes.torque, -wire[4], wire[4], 12)
    return OK


cdef inline int encode_command(double *arena, const Mit *at, Frame *frame) noexcept nogil:
    """Encode the frame of a tick to the drive's id. Returns 1, or the negated reason for rejection."""
    cdef double *wire = arena + at.wire
    cdef Codes codes
    cdef int status = quantise(arena, at, 2.0 * wire[0] / 0xFFFF, 2.0 * wire[1] / 0xFFF, &codes)
    if status != OK:
        return -status
    memset(frame, 0, sizeof(Frame))
    frame.id = <uint32_t>arena[at.can_id]
    frame.length = 8
    pack(frame.data, codes.position, codes.velocity, codes.stiffness, codes.damping, codes.torque)
    return 1


cdef inline void decode_motion(double *arena, const Mit *at, const uint8_t *data) noexcept nogil:
    """Decode p16 v12 t12 of a reply, after the id of the drive."""
    cdef double *wire = arena + at.wire
    cdef double sign = -1.0 if arena[at.invert] != 0.0 else 1.0
    arena[at.position] = sign * from_code(<uint32_t>data[1] << 8 | data[2], -wire[0], wire[0], 16) - arena[at.offset]
    arena[at.velocity] = sign * from_code(<uint32_t>data[3] << 4 | data[4] >> 4, -wire[1], wire[1], 12)
    arena[at.torque] = sign * from_code((<uint32_t>data[4] & 15) << 8 | data[5], -wire[4], wire[4], 12)


cdef inline void pack_motion(
        uint8_t *data, uint32_t id, const double *wire, double position, double velocity, double torque) noexcept nogil:
    """Encode the first six bytes of a reply."""
    cdef uint32_t p = to_code(position, -wire[0], wire[0], 16)
    cdef uint32_t v = to_code(velocity, -wire[1], wire[1], 12)
    cdef uint32_t t = to_code(torque, -wire[4], wire[4], 12)
    data[0] = <uint8_t>id
    data[1] = <uint8_t>(p >> 8)
    data[2] = <uint8_t>p
    data[3] = <uint8_t>(v >> 4)
    data[4] = <uint8_t>((v & 15) << 4 | t >> 8)
    data[5] = <uint8_t>t
