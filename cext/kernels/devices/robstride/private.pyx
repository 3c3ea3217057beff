# cython: freethreading_compatible=True
"""RobStride and CyberGear: the private protocol, as sent and received by a controller.

    identifier   29 bits: type 5, data 16, target 8
    type 0       get id: answered by type 0 to NEWCOMER, with the unique number of the drive, 64 bits
    type 1       operation control: torque is the data of the identifier; position, velocity, stiffness, damping, u16
    each, big-endian
    type 2       feedback: mode 2 bits, faults 6 bits, motor 8 bits; position, velocity, torque, temperature x 10
    type 17      read a parameter: index u16, 0; answered by type 17 with the value, and 0 in bits 16 to 23 of the
                 identifier if the parameter exists
    type 18      write a parameter: index u16, 0, four bytes, little-endian; answered by type 2
    type 21      faults and warnings, u32 each, little-endian
    type 24      as type 2, periodic

RobStride user manuals of 2026-04-28, section 4.1; CyberGear manual, section 4.1.
"""

from libc.math cimport isfinite
from libc.stdint cimport int16_t, int32_t, uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    AUTHORITY, COMMANDED, EXTENDED, FOREIGN, IDLE, ID_MASK, ITEMS, MALFORMED, NOTED, NOT_FINITE, OK, OUT_OF_LIMITS,
    PERIOD, POWER_LOSS, TAKEN, TWIN, Frame, decode_t, encode_t, export_decode, export_encode, items,
)
from cext.kernels.devices.drive_law cimport Known, Law, accept, keep_inside, know_times
from cext.kernels.devices.fields cimport from_code, to_code, to_code_inward
from cext.kernels.devices.robstride.settings cimport (
    PLACE, READY, VALUE, compare_motion, differs, little_endian, note_read, place_of, settings_size,
)

cdef enum:
    NEWCOMER = 0xFE             # target of the reply with the unique number
    RUN = 2                     # mode of an enabled drive
    STOPPED_REPLY_LIMIT = 12    # replies of a drive that has stopped by itself; more than arming has frames
    STOPPED = 64                # in `fault`, next to the six bits of type 2
    # in `fault`: the drive has returned another value of a setting than was written; the 32 bits from WORD on are then
    # that value, and the next four the place of the setting
    DIFFERENT = 128
    WORD = 256                  # in `fault`: start of the 32 bits of type 21

cdef enum:                      # first item of `unique`: its two others are
    UNREAD = 0
    READ                        # the number that the drive has returned
    EXPECTED                    # the number that it must return, before it is ready
    RETURNED                    # and has returned

cdef double PLACE_UNIT = 1099511627776.0        # in `fault`: start of the place, 2⁴⁰


cdef inline double big_endian(const uint8_t *data, double half) noexcept nogil:
    return from_code(<uint32_t>data[0] << 8 | data[1], -half, half, 16)


cdef struct Address:
    int32_t can_id, host_id

cdef struct Feedback:
    Address address
    int32_t position, velocity, torque, temperature, fault, warning, invert, offset
    int32_t wire                # position, velocity, stiffness, damping, torque: half ranges at the joint
    # consecutive replies, of those under torque, in which it did not run; faults of type 21
    int32_t state
    int32_t settings, read_back # see cext/kernels/devices/robstride/settings.pxd
    int32_t arrival             # time of the newest frame, s
    int32_t gear_ratio
    int32_t unique              # UNREAD to RETURNED; upper and lower half of the unique number

FEEDBACK = items((<Feedback *>ITEMS)[0], "wire[5] state[2] read_back[5] unique[3] " + settings_size())


cdef inline void tell_fault(double *arena, const Feedback *at, uint32_t bits) noexcept nogil:
    """Set the output. bits : of type 2, and STOPPED"""
    cdef double *read = arena + at.read_back
    if differs(read):
        arena[at.fault] = bits + DIFFERENT + WORD * read[VALUE] + PLACE_UNIT * read[PLACE]
    else:
        arena[at.fault] = bits + WORD * (arena + at.state)[1]


cdef inline uint32_t bits_of(double fault) noexcept nogil:
    """Return the bits of type 2, and STOPPED, of the output."""
    return <uint32_t>(<uint64_t>fault & (DIFFERENT - 1))


cdef inline void note_arrival(double *arena, const Feedback *at, const Frame *frame) noexcept nogil:
    """Forget the fault report and the number of a drive that may have restarted, or was replaced, while the run waits
    to be armed again. It must return an expected number once more.
    """
    cdef double came = frame.time * 1e-9
    cdef double *state = arena + at.state
    if arena[AUTHORITY] == 0.0 and came - arena[at.arrival] > 1e-9 * POWER_LOSS:
        state[1] = 0.0
        arena[at.unique] = EXPECTED if arena[at.unique] >= EXPECTED else UNREAD
        tell_fault(arena, at, bits_of(arena[at.fault]))
    arena[at.arrival] = came


cdef int feedback(double *arena, const Feedback *at, const Frame *frame, bint asked) noexcept nogil:
    """Decode types 2 and 24."""
    cdef double *wire = arena + at.wire
    cdef double *state = arena + at.state
    cdef double sign = -1.0 if arena[at.invert] != 0.0 else 1.0
    cdef uint32_t faults = frame.id >> 16 & 63
    cdef bint runs = (frame.id >> 22 & 3) == RUN
    arena[at.position] = sign * big_endian(&frame.data[0], wire[0]) - arena[at.offset]
    arena[at.velocity] = sign * big_endian(&frame.data[2], wire[1])
    arena[at.torque] = sign * big_endian(&frame.data[4], wire[4])
    arena[at.temperature] = 0.1 * <int16_t>(<uint16_t>(frame.data[6] << 8 | frame.data[7]))
    if runs or arena[AUTHORITY] == 0.0:     # without authority, the run itself may have disabled it
        state[0] = 0.0
    elif state[0] <= STOPPED_REPLY_LIMIT:
        state[0] += 1.0
    tell_fault(arena, at, faults + (STOPPED if state[0] > STOPPED_REPLY_LIMIT else 0))
    if not asked:
        return NOTED            # a periodic report does not confirm a command
    return TAKEN if runs else IDLE


cdef int report(double *arena, const Feedback *at, const Frame *frame) noexcept nogil:
    cdef double *state = arena + at.state
    cdef const uint8_t *data = &frame.data[0]
    state[1] = little_endian(data)
    tell_fault(arena, at, bits_of(arena[at.fault]))
    arena[at.warning] = little_endian(data + 4)
    return NOTED


cdef int parameter(double *arena, const Feedback *at, const Frame *frame) noexcept nogil:
    """Decode type 17: a parameter that was read during arming."""
    cdef double *read = arena + at.read_back
    if arena[at.unique] == EXPECTED:        # of which unit it is a parameter is not known
        return NOTED
    if read[READY] == 0.0 and (frame.id >> 16 & 255) == 0 and compare_motion(
            read, &frame.data[0], arena[at.invert], arena[at.gear_ratio], arena[at.position] + arena[at.offset],
            arena[at.velocity], (arena + at.wire)[0]):
        tell_fault(arena, at, bits_of(arena[at.fault]))
        return NOTED
    cdef int place = place_of(arena + at.settings, <uint32_t>frame.data[1] << 8 | frame.data[0])
    if place < 0 or read[READY] != 0.0:
        return NOTED
    note_read(arena + at.settings, read, place, little_endian(&frame.data[4]), (frame.id >> 16 & 255) == 0)
    tell_fault(arena, at, bits_of(arena[at.fault]))
    return NOTED


cdef int identity(double *arena, const Feedback *at, const Frame *frame) noexcept nogil:
    """Decode type 0: another number than the one before, or than the expected one, is another drive."""
    cdef double *unique = arena + at.unique
    cdef uint32_t high = little_endian(&frame.data[4]), low = little_endian(&frame.data[0])
    if unique[0] == UNREAD:
        unique[0], unique[1], unique[2] = READ, high, low
    if unique[1] != high or unique[2] != low:
        return TWIN
    if unique[0] == EXPECTED:
        unique[0] = RETURNED
    return NOTED


cdef int robstride_decode(double *arena, const Feedback *at, const Feedback *sizes, const Frame *frame) noexcept nogil:
    cdef uint32_t motor = <uint32_t>arena[at.address.can_id]
    cdef uint32_t host = <uint32_t>arena[at.address.host_id]
    cdef uint32_t type = frame.id >> 24 & 31
    cdef uint32_t target = frame.id & 255
    cdef uint32_t source = frame.id >> 8 & 255
    if (frame.id & ~<uint32_t>ID_MASK) != EXTENDED:
        return FOREIGN
    if target == motor and type in (1, 3, 4, 6, 7, 18):
        # by another controller, except reads: frames of this run are not received
        return COMMANDED
    if type == 21:              # the manual is inconsistent in the order of motor and host
        if not (target == host and source == motor or target == motor and source == host):
            return FOREIGN
        if frame.length != 8:
            return MALFORMED
        note_arrival(arena, at, frame)
        return report(arena, at, frame)
    if source != motor or not (target == host and type in (2, 17, 24) or target == NEWCOMER and type == 0):
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    note_arrival(arena, at, frame)
    if type == 0:
        return identity(arena, at, frame)
    return parameter(arena, at, frame) if type == 17 else feedback(arena, at, frame, type == 2)


cdef inline void address(double *arena, const Address *at, Frame *frame, uint32_t type, uint32_t data) noexcept nogil:
    memset(frame, 0, sizeof(Frame))
    frame.id = <uint32_t>EXTENDED | type << 24 | data << 8 | <uint32_t>arena[at.can_id]
    frame.length = 8


cdef inline void put(uint8_t *data, uint32_t code) noexcept nogil:
    data[0] = <uint8_t>(code >> 8)
    data[1] = <uint8_t>code


cdef struct Operation:
    Address address
    int32_t position_command, velocity_command, torque_command, stiffness_command, damping_command, position
    int32_t velocity, age, torque_sent, limited, invert, offset, max_acceleration, max_transit, wire
    int32_t transit             # s, the longest measured, and what the age of the feedback does not contain
    # limits of the five commands and of the drive's whole law; permitted fraction of stiffness and damping
    int32_t limits
    int32_t sent                # position, velocity, stiffness, damping, torque of the last frame

OPERATION = items((<Operation *>ITEMS)[0], "transit[3] wire[5] limits[7] sent[5]")


cdef bint limit_law(double *arena, const Operation *at, Law *law) noexcept nogil:
    """Limit a law with stiffness or damping. Returns whether it was changed."""
    cdef double *wire = arena + at.wire
    cdef double *limits = arena + at.limits
    cdef Known known
    know_times(&known, arena[at.age], arena[PERIOD], arena[at.max_transit], arena + at.transit)
    known.position, known.velocity = arena[at.position], arena[at.velocity]
    known.acceleration, known.gains = arena[at.max_acceleration], limits[6]
    known.offset, known.position_end, known.velocity_end = arena[at.offset], wire[0], wire[1]
    known.position_step, known.velocity_step = 2.0 * wire[0] / 0xFFFF, 2.0 * wire[1] / 0xFFFF
    known.stiffness_step, known.damping_step = wire[2] / 0xFFFF, wire[3] / 0xFFFF
    known.share = arena[AUTHORITY]
    return keep_inside(law, &known, limits[5])


cdef int operation_encode(double *arena, const Operation *at, const Operation *sizes, Frame *frames) noexcept nogil:
    cdef double *wire = arena + at.wire
    cdef double *limits = arena + at.limits
    cdef double *sent = arena + at.sent
    cdef double sign = -1.0 if arena[at.invert] != 0.0 else 1.0
    cdef double share = arena[AUTHORITY]
    cdef Law law
    cdef bint limited
    cdef int status
    cdef uint32_t code
    law.position, law.velocity, law.torque = (
        arena[at.position_command], arena[at.velocity_command], arena[at.torque_command])
    law.stiffness, law.damping = arena[at.stiffness_command], arena[at.damping_command]
    status = accept(&law, limits, share, &limited)
    if status != OK:
        return -status
    if share > 0.0 and (law.stiffness > 0.0 or law.damping > 0.0):
        limited |= limit_law(arena, at, &law)
    arena[at.limited] += limited
    law.torque *= sign * share
    code = to_code_inward(law.torque, wire[4], 16) if limited else to_code(law.torque, -wire[4], wire[4], 16)
    address(arena, &at.address, &frames[0], 1, code)
    sent[4] = arena[at.torque_sent] = sign * from_code(code, -wire[4], wire[4], 16)
    code = to_code(sign * (law.position + arena[at.offset]), -wire[0], wire[0], 16)
    put(&frames[0].data[0], code)
    sent[0] = sign * from_code(code, -wire[0], wire[0], 16) - arena[at.offset]
    code = to_code(sign * law.velocity, -wire[1], wire[1], 16)
    put(&frames[0].data[2], code)
    sent[1] = sign * from_code(code, -wire[1], wire[1], 16)
    code = to_code(share * law.stiffness, 0.0, wire[2], 16)
    put(&frames[0].data[4], code)
    sent[2] = from_code(code, 0.0, wire[2], 16)
    code = to_code(share * law.damping, 0.0, wire[3], 16)
    put(&frames[0].data[6], code)
    sent[3] = from_code(code, 0.0, wire[3], 16)
    return 1


cdef inline float write(double *arena, const Address *at, Frame *frame, double index, double value) noexcept nogil:
    """Write a frame of type 18. Returns the value as sent, little-endian as the supported processors."""
    cdef float single = <float>value
    cdef uint32_t where = <uint32_t>index
    address(arena, at, frame, 18, <uint32_t>arena[at.host_id])
    frame.data[0] = <uint8_t>where
    frame.data[1] = <uint8_t>(where >> 8)
    memcpy(&frame.data[4], &single, 4)
    return single


cdef struct Written:
    Address address
    int32_t command             # input of the mode
    int32_t command_sent        # output with the value sent
    int32_t invert, offset
    int32_t limits              # limits of the command; fraction of them that the drive monitor permits
    # index of the command, its scale to the motor, whether the offset applies, index of the current limit, A
    int32_t written

WRITTEN = items((<Written *>ITEMS)[0], "limits[2] written[5]")


cdef int written_encode(double *arena, const Written *at, const Written *sizes, Frame *frames) noexcept nogil:
    """Encode the command of a parameter mode, followed by the current limit if the mode has one."""
    cdef double *written = arena + at.written
    cdef double limit = arena[at.limits]
    cdef double sign = -1.0 if arena[at.invert] != 0.0 else 1.0
    cdef double share = arena[AUTHORITY]
    cdef double command = arena[at.command]
    cdef double shift = arena[at.offset] if written[2] != 0.0 else 0.0
    cdef double sent
    if not isfinite(command):
        return -NOT_FINITE
    if not -limit <= command <= limit or not 0.0 <= share <= 1.0:
        return -OUT_OF_LIMITS
    share *= arena[at.limits + 1]
    if written[3] == 0.0:       # the command itself sets the torque
        command *= share
    sent = write(arena, &at.address, &frames[0], written[0], sign * (command + shift) * written[1])
    arena[at.command_sent] = sign * sent / written[1] - shift
    if written[3] == 0.0:
        return 1
    write(arena, &at.address, &frames[1], written[3], share * written[4])
    return 2


decode = export_decode(<decode_t>robstride_decode, FEEDBACK)
encode_operation = export_encode(<encode_t>operation_encode, OPERATION)
encode_written = export_encode(<encode_t>written_encode, WRITTEN)
