# cython: freethreading_compatible=True
"""moteus controllers in position mode, for the driver and the emulated drive. The frames are those of protocol.py."""

from libc.math cimport NAN, ceil, isfinite, llround
from libc.stdint cimport int8_t, int16_t, int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    AUTHORITY, COMMANDED, ERROR_FRAME, EXTENDED, FOREIGN, ID_MASK, IDLE, ITEMS, MALFORMED, NOTED, NOT_FINITE, OK, REMOTE,
    TAKEN, TIME, Frame, decode_t, encode_t, export, export_decode, export_encode, items, kernel_t,
)
from cext.conversion cimport inside_of, to_u32
cimport cext.kernels.devices.drives as drives
from cext.kernels.devices.drive_law cimport Law, accept
from cext.kernels.devices.mit cimport Mit, limit_law, mit_sizes

cdef enum:
    STOPPED = 0, FAULT = 1, POSITION = 10, TIMEOUT = 11         # modes
    COMMAND_BYTES = 48, REPLY_BYTES = 24
    NOP = 0x50
    INT8 = 0, INT16 = 1, INT32 = 2, FLOAT = 3                   # types of registers in subframes
    NOT_SET = -2147483648
    HOT = 38                                                    # fault

cdef double TURN = 6.283185307179586
cdef double STEP = 1e-5                                         # revolutions, and revolutions/s, of int32
cdef double TORQUE_STEP = 1e-3                                  # N·m
cdef double WHOLE = 2147483647.0                                # of kp and kd


cdef inline int32_t int32_at(const uint8_t *data) noexcept nogil:
    cdef int32_t value
    memcpy(&value, data, 4)
    return value


cdef struct Driver:
    Mit mit
    int32_t gear_ratio, can_timeout

DRIVER = items((<Driver *>ITEMS)[0], mit_sizes())


cdef int driver_decode(double *arena, const Driver *at, const Driver *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    cdef uint32_t can_id = <uint32_t>arena[at.mit.can_id]
    cdef uint32_t id = frame.id & <uint32_t>ID_MASK
    cdef double turn = TURN / arena[at.gear_ratio]
    cdef double sign = -1.0 if arena[at.mit.invert] != 0.0 else 1.0
    cdef int mode, position, velocity, torque
    if frame.id & (<uint32_t>REMOTE | <uint32_t>ERROR_FRAME) or id > 0xFFFF:
        return FOREIGN
    if id & 0xFF == can_id and frame.length > 0 and data[0] < 0x10:
        return COMMANDED        # another host writes its registers
    if id != can_id << 8:
        return FOREIGN
    if frame.length < 3 or data[0] != 0x28 or data[1] != 4 or data[2] != 0:
        return NOTED            # a reply to another program's query
    mode, position, velocity, torque = (
        int32_at(data + 3), int32_at(data + 7), int32_at(data + 11), int32_at(data + 15))
    if (frame.length != REPLY_BYTES or data[19] != 0x23 or data[20] != 0x0D or position == NOT_SET
            or velocity == NOT_SET or torque == NOT_SET or data[22] == 0x80):
        return MALFORMED
    arena[at.mit.position] = sign * STEP * turn * position - arena[at.mit.offset]
    arena[at.mit.velocity] = sign * STEP * turn * velocity
    arena[at.mit.torque] = sign * TORQUE_STEP * arena[at.gear_ratio] * torque
    arena[at.mit.temperature] = <int8_t>data[22]
    if mode == FAULT:
        arena[at.mit.fault] = <int8_t>data[23] if data[23] != 0 else FAULT
    else:                       # 2 to 4: the drive is being enabled
        arena[at.mit.fault] = 0 if mode == STOPPED or 2 <= mode <= 4 or mode == POSITION else mode & 0x7F
    return TAKEN if mode == POSITION else IDLE


cdef inline void put32(uint8_t *data, double x) noexcept nogil:
    """Write an int32, rounded towards zero; never the value that means none."""
    cdef int32_t code = <int32_t>inside_of(x, -2147483647, 2147483647)
    memcpy(data, &code, 4)


cdef int driver_encode(double *arena, const Driver *at, const Driver *sizes, Frame *frames) noexcept nogil:
    cdef double *wire = arena + at.mit.wire
    cdef double *sent = arena + at.mit.sent
    cdef uint8_t *data = &frames[0].data[0]
    cdef double ratio = arena[at.gear_ratio]
    cdef double turn = TURN / ratio
    cdef double sign = -1.0 if arena[at.mit.invert] != 0.0 else 1.0
    cdef double share = arena[AUTHORITY]
    cdef int32_t none = NOT_SET
    cdef int16_t timeout = <int16_t>llround(1e3 * arena[at.can_timeout])
    cdef Law law
    cdef bint limited
    cdef int status
    law.position, law.velocity, law.torque = (
        arena[at.mit.position_command], arena[at.mit.velocity_command], arena[at.mit.torque_command])
    law.stiffness, law.damping = arena[at.mit.stiffness_command], arena[at.mit.damping_command]
    status = accept(&law, arena + at.mit.limits, share, &limited)
    if status != OK:
        return -status
    if share > 0.0 and (law.stiffness > 0.0 or law.damping > 0.0):
        limited |= limit_law(arena, &at.mit, STEP * turn, STEP * turn, &law)
    arena[at.mit.limited] += limited
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].id = <uint32_t>EXTENDED | 0x8000 | <uint32_t>arena[at.mit.can_id]
    frames[0].length = COMMAND_BYTES
    memcpy(data, b"\x01\x00\x0a\x08\x06\x20", 6)
    put32(data + 6, (sign * (law.position + arena[at.mit.offset]) / turn) / STEP)
    put32(data + 10, (sign * law.velocity / turn) / STEP)
    put32(data + 14, (sign * share * law.torque / ratio) / TORQUE_STEP)
    put32(data + 18, share * law.stiffness / wire[2] * WHOLE)
    put32(data + 22, share * law.damping / wire[3] * WHOLE)
    put32(data + 26, ceil((arena + at.mit.limits)[5] / ratio / TORQUE_STEP))    # the drive's own limit of the whole law
    if int32_at(data + 18) == 0:
        memcpy(data + 6, &none, 4)                              # without stiffness: where the joint is
    memcpy(data + 30, b"\x05\x27", 2)
    memcpy(data + 32, &timeout, 2)
    memcpy(data + 34, b"\x02\x28\xff\xff\x01\x2b\x00\x18\x04\x00\x13\x0d\x50\x50", 14)
    sent[0] = law.position if int32_at(data + 18) == 0 else sign * STEP * turn * int32_at(data + 6) - arena[at.mit.offset]
    sent[1] = sign * STEP * turn * int32_at(data + 10)
    sent[2] = int32_at(data + 18) / WHOLE * wire[2]
    sent[3] = int32_at(data + 22) / WHOLE * wire[3]
    sent[4] = arena[at.mit.torque_sent] = sign * TORQUE_STEP * ratio * int32_at(data + 14)
    return 1


# The emulated drive

cdef struct Emulated:
    drives.Drive drive
    int32_t supply
    int32_t mode
    int32_t latched             # fault until a stop clears it
    int32_t permitted           # largest torque in N·m at the drive, time-out in s

EMULATED = items((<Emulated *>ITEMS)[0], drives.drive_sizes() + " permitted[2]")


cdef inline double unit_of(uint32_t register, int kind) noexcept nogil:
    """Return the value of one code of a register. kind : type, as in a subframe"""
    if kind == FLOAT:
        return 1.0
    if register == 0x01 or register == 0x20:                    # revolutions
        return 1e-2 if kind == INT8 else 1e-4 if kind == INT16 else 1e-5
    if register == 0x02 or register == 0x21:                    # revolutions/s
        return 0.1 if kind == INT8 else 2.5e-4 if kind == INT16 else 1e-5
    if register == 0x03 or register == 0x22 or register == 0x25:    # N·m
        return 0.5 if kind == INT8 else 1e-2 if kind == INT16 else 1e-3
    if register == 0x23 or register == 0x24:
        return 1.0 / (127.0 if kind == INT8 else 32767.0 if kind == INT16 else WHOLE)
    if register == 0x27:                                        # s
        return 1e-2 if kind == INT8 else 1e-3 if kind == INT16 else 1e-6
    if register == 0x0D:                                        # V
        return 0.5 if kind == INT8 else 0.1 if kind == INT16 else 1e-3
    if register == 0x0E:                                        # °C
        return 1.0 if kind == INT8 else 0.1 if kind == INT16 else 1e-3
    return 1.0


cdef inline bint varuint(const uint8_t *data, int length, int *at, uint32_t *value) noexcept nogil:
    """Read a number of seven bits a byte, the lowest first. Returns whether it is complete."""
    cdef int shift = 0
    value[0] = 0
    while at[0] < length and shift < 35:
        value[0] |= (<uint32_t>data[at[0]] & 0x7F) << shift
        at[0] += 1
        shift += 7
        if data[at[0] - 1] < 0x80:
            return True
    return False


cdef inline int size_of(int kind) noexcept nogil:
    return 1 if kind == INT8 else 2 if kind == INT16 else 4


cdef inline double value_at(const uint8_t *data, uint32_t register, int kind) noexcept nogil:
    """Return the value of a register in a subframe; NaN for one that is not set."""
    cdef int16_t word
    cdef float single
    cdef double code = <int8_t>data[0]
    if kind == FLOAT:
        memcpy(&single, data, 4)
        return single
    if kind == INT16:
        memcpy(&word, data, 2)
        code = word
    elif kind == INT32:
        code = int32_at(data)
    if code == (-128.0 if kind == INT8 else -32768.0 if kind == INT16 else -2147483648.0):
        return NAN
    return code * unit_of(register, kind)


cdef inline void put(uint8_t *data, uint32_t register, int kind, double value) noexcept nogil:
    """Write the value of a register, the nearest that the type has."""
    cdef double end = 127.0 if kind == INT8 else 32767.0 if kind == INT16 else WHOLE
    cdef double code = value / unit_of(register, kind)
    cdef float single = <float>value
    cdef int32_t whole = <int32_t>llround(end if code > end else -end if code < -end else code)
    memcpy(data, <const void *>&single if kind == FLOAT else <const void *>&whole, size_of(kind))


cdef inline double motor_torque(double *arena, const Emulated *at) noexcept nogil:
    """Return the torque of the drive's law within the permitted one; in the time-out it damps."""
    cdef double *wire = arena + at.drive.wire
    cdef double gear = arena[at.drive.gear_ratio]
    cdef double torque = 0.0
    if arena[at.mode] == POSITION:
        torque = drives.within(drives.law(arena, &at.drive), gear * (arena + at.permitted)[0])
    elif arena[at.mode] == TIMEOUT:
        torque = drives.within(-wire[3] * drives.seen_velocity(arena, &at.drive), 5.0 * gear)
    return drives.strayed(arena, &at.drive, torque)


cdef void write_register(double *arena, const Emulated *at, uint32_t register, double value) noexcept nogil:
    cdef double *command = arena + at.drive.command
    cdef double *wire = arena + at.drive.wire
    cdef double gear = arena[at.drive.gear_ratio]
    cdef double turn = TURN / gear
    if register == 0:
        if value == STOPPED:
            arena[at.mode] = arena[at.latched] = 0.0
        elif value == POSITION and arena[at.mode] == STOPPED:
            arena[at.mode] = POSITION                           # fault and time-out need a stop first
        command[0] = command[1] = command[4] = 0.0              # values that the frame does not have
        command[2], command[3] = wire[2], wire[3]
        (arena + at.permitted)[0], (arena + at.permitted)[1] = 1e9, 0.1
    elif register == 0x20:
        command[0] = turn * value if isfinite(value) else drives.seen_position(arena, &at.drive)
    elif register == 0x21:
        command[1] = turn * value if isfinite(value) else 0.0
    elif register == 0x22 and isfinite(value):
        command[4] = gear * value
    elif (register == 0x23 or register == 0x24) and isfinite(value):
        command[register - 0x21] = value * wire[register - 0x21]
    elif register == 0x25 and isfinite(value):
        (arena + at.permitted)[0] = value
    elif register == 0x27 and value != 0.0:
        (arena + at.permitted)[1] = value                       # NaN: none
    elif register == 0x130 or register == 0x131:
        drives.set_zero(arena, &at.drive)


cdef double read_register(double *arena, const Emulated *at, uint32_t register) noexcept nogil:
    cdef double turn = TURN / arena[at.drive.gear_ratio]
    if register == 0:
        return arena[at.mode]
    if register == 1:
        return drives.seen_position(arena, &at.drive) / turn
    if register == 2:
        return drives.seen_velocity(arena, &at.drive) / turn
    if register == 3:
        return motor_torque(arena, at) / arena[at.drive.gear_ratio]
    if register == 0x0D:
        return arena[at.supply]
    if register == 0x0E:
        return arena[at.drive.temperature]
    return arena[at.latched] if register == 0x0F and arena[at.mode] == FAULT else 0.0


cdef int emulated_decode(double *arena, const Emulated *at, const Emulated *sizes, const Frame *frame) noexcept nogil:
    """Write registers at once, and queue what is read: the reply has the state at the end of the step."""
    cdef const uint8_t *data = &frame.data[0]
    cdef uint32_t id = frame.id & <uint32_t>ID_MASK
    cdef uint8_t reads[8]
    cdef uint32_t count, first, number
    cdef int place = 0
    cdef int kept = 0
    cdef int begin, kind
    if frame.id & <uint32_t>REMOTE or id > 0xFFFF or id & 0xFF != <uint32_t>arena[at.drive.can_id]:
        return FOREIGN
    if drives.unreachable(arena, &at.drive):
        return TAKEN
    memset(reads, NOP, sizeof(reads))
    while place < frame.length and data[place] < 0x20:
        begin, kind, count = place, data[place] >> 2 & 3, data[place] & 3
        place += 1
        if count == 0 and not varuint(data, frame.length, &place, &count):
            return MALFORMED
        if not varuint(data, frame.length, &place, &first) or count > 64:
            return MALFORMED
        if data[begin] >= 0x10:
            if kept + place - begin <= <int>sizeof(reads):
                memcpy(reads + kept, data + begin, place - begin)
                kept += place - begin
            continue
        if place + <int>count * size_of(kind) > frame.length:
            return MALFORMED
        for number in range(count):
            write_register(arena, at, first + number, value_at(data + place, first + number, kind))
            place += size_of(kind)
        (arena + at.drive.state)[drives.LAST_COMMAND] = arena[TIME]
    if id & 0x8000 and kept > 0:
        drives.owe(arena, &at.drive, id >> 8 & 0x7F, kept, reads)
    return TAKEN


cdef int emulated_kernel(double *arena, const Emulated *at, const Emulated *sizes) noexcept nogil:
    cdef double *state = arena + at.drive.state
    cdef double timeout = (arena + at.permitted)[1]
    drives.look(arena, &at.drive)
    if arena[at.drive.power_lost] != 0.0:
        drives.forget(arena, &at.drive)
        arena[at.mode] = arena[at.latched] = 0.0
    if arena[at.drive.fault] != 0.0:
        arena[at.latched] = to_u32(arena[at.drive.fault]) & 0x7F
    elif arena[at.drive.temperature] >= arena[at.drive.trip_temperature]:
        arena[at.latched] = HOT
    if arena[at.latched] != 0.0:
        arena[at.mode] = FAULT
    elif arena[at.mode] == POSITION and arena[TIME] - state[drives.LAST_COMMAND] > timeout:
        arena[at.mode] = TIMEOUT
    state[drives.RUNNING] = arena[at.mode] == POSITION
    arena[at.drive.torque] = drives.produced(arena, &at.drive, motor_torque(arena, at))
    arena[at.drive.enabled] = arena[at.mode] != STOPPED and arena[at.mode] != FAULT
    return OK


cdef void expand(double *arena, const Emulated *at, Frame *frame) noexcept nogil:
    """Replace the reads in a frame by their replies, and its host by the identifier."""
    cdef uint8_t reads[8]
    cdef int end = frame.length
    cdef int place = 0
    cdef int length = 0
    cdef int kind, begin
    cdef uint32_t count, first, number
    cdef uint32_t id = drives.own_id(arena, &at.drive) << 8 | frame.id
    memcpy(reads, frame.data, sizeof(reads))
    while place < end:
        begin, kind, count = place, reads[place] >> 2 & 3, reads[place] & 3
        place += 1
        if (count == 0 and not varuint(reads, end, &place, &count)) or not varuint(reads, end, &place, &first):
            break
        if length + place - begin + <int>count * size_of(kind) > 64:
            break
        memcpy(frame.data + length, reads + begin, place - begin)
        frame.data[length] += 0x10                              # of a read, to that of its reply
        length += place - begin
        for number in range(count):
            put(frame.data + length, first + number, kind, read_register(arena, at, first + number))
            length += size_of(kind)
    while length > 8 and (length < 24 and length % 4 or 24 < length < 32 or 32 < length < 48 or 48 < length < 64):
        frame.data[length] = NOP
        length += 1
    frame.length = <uint8_t>length
    frame.id = id | (<uint32_t>EXTENDED if id > 0x7FF else 0)


cdef int emulated_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef int index, count
    if not drives.answerable(arena, &at.drive):
        return -NOT_FINITE
    count = drives.deliver(arena, &at.drive, frames)
    for index in range(count):
        expand(arena, at, &frames[index])
    return count


decode = export_decode(<decode_t>driver_decode, DRIVER)
encode = export_encode(<encode_t>driver_encode, DRIVER)
drive = export(<kernel_t>emulated_kernel, EMULATED)
drive_decode = export_decode(<decode_t>emulated_decode, EMULATED)
drive_encode = export_encode(<encode_t>emulated_encode, EMULATED)
