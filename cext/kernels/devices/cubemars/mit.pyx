# cython: freethreading_compatible=True
"""CubeMars AK in MIT mode: encoding of frames, for the driver and the emulated drive.

    command    p16 v12 kp12 kd12 t12, most significant bit first, to the drive's id
    special    FF FF FF FF FF FF FF FC enable, FD disable, FE this position is zero
    reply      id p16 v12 t12 temperature error, from the drive's id or from 0; temperature in °C + 40
               other firmware sends 6 bytes, id p16 v12 t12; or 7, the last of which is a voltage: then temperature and
               error are unknown

AK Series Module Driver Manual V1.0.18, pages 64 to 68. A code is (x - low) (2^n - 1) / (high - low), truncated and
clamped: the manual's 2^n wraps at the top, where +12.5 rad would become -12.5 rad.
"""

from libc.math cimport NAN
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    FOREIGN, ITEMS, MALFORMED, NOT_FINITE, OK, TAKEN, Frame, decode_t, encode_t, export, export_decode,
    export_encode, items, kernel_t,
)
from cext.conversion cimport to_u8
cimport cext.kernels.devices.drives as drives
from cext.kernels.devices.mit cimport Mit, all_ones, decode_motion, encode_command, mit_sizes, pack_motion, unpack

cdef enum:
    TOO_HOT = 1                 # error code
    VOLTAGE = 48                # V, in a reply of 7 bytes


cdef bint is_special(const uint8_t *data) noexcept nogil:
    return all_ones(data, 7) and data[7] >= 0xFC and data[7] <= 0xFE


cdef struct CubeMars:
    Mit mit
    int32_t reply               # bytes of a reply

CUBE_MARS = items((<CubeMars *>ITEMS)[0], mit_sizes())


cdef int cubemars_decode(double *arena, const CubeMars *at, const CubeMars *sizes, const Frame *frame) noexcept nogil:
    cdef uint32_t id = <uint32_t>arena[at.mit.can_id]
    cdef const uint8_t *data = &frame.data[0]
    if frame.id != id and (frame.id != 0 or frame.length == 0 or data[0] != id):
        return FOREIGN          # an extended, remote or error frame differs in its high bits
    if frame.length != arena[at.reply] or data[0] != id:
        return MALFORMED
    decode_motion(arena, &at.mit, data)
    if frame.length == 8:
        arena[at.mit.temperature] = <double>data[6] - 40.0
        arena[at.mit.fault] = data[7]
    else:
        arena[at.mit.temperature] = NAN
    return TAKEN


cdef int cubemars_encode(double *arena, const CubeMars *at, const CubeMars *sizes, Frame *frames) noexcept nogil:
    cdef int count = encode_command(arena, &at.mit, &frames[0])
    if count == 1 and is_special(frames[0].data):
        # all ranges at their top would encode enable, disable or zero: reduce the position by one code
        frames[0].data[1] -= 1
    return count


cdef struct Emulated:
    drives.Drive drive
    int32_t reply               # bytes of a reply

EMULATED = items((<Emulated *>ITEMS)[0], drives.drive_sizes())


cdef int emulated_decode(double *arena, const Emulated *at, const Emulated *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + at.drive.state
    cdef double *command = arena + at.drive.command
    cdef const uint8_t *data = &frame.data[0]
    if frame.id != <uint32_t>arena[at.drive.can_id]:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if drives.unreachable(arena, &at.drive):
        return TAKEN
    if is_special(data):
        if data[7] == 0xFC:
            state[drives.RUNNING] = 1.0
        elif data[7] == 0xFD:
            state[drives.RUNNING] = 0.0
            memset(command, 0, 5 * sizeof(double))
        else:
            state[drives.ZERO] += drives.seen_position(arena, &at.drive)
    elif state[drives.RUNNING] != 0.0:
        unpack(data, arena + at.drive.wire, command)
    drives.owe(arena, &at.drive, 0, 0, NULL)
    return TAKEN


cdef inline uint8_t error_code(double *arena, const drives.Drive *at) noexcept nogil:
    if arena[at.fault] != 0.0:
        return to_u8(arena[at.fault])
    return TOO_HOT if arena[at.temperature] >= arena[at.trip_temperature] else 0


cdef inline double motor_torque(double *arena, const drives.Drive *at) noexcept nogil:
    """Return the torque of the drive's law, limited by its current."""
    cdef bint gives = (arena + at.state)[drives.RUNNING] != 0.0 and error_code(arena, at) == 0
    return drives.strayed(arena, at, drives.law(arena, at) if gives else 0.0)


cdef int emulated_kernel(double *arena, const Emulated *at, const Emulated *sizes) noexcept nogil:
    drives.look(arena, &at.drive)
    if arena[at.drive.power_lost] != 0.0:
        drives.forget(arena, &at.drive)
    arena[at.drive.torque] = drives.turned(arena, &at.drive, motor_torque(arena, &at.drive))
    arena[at.drive.enabled] = (arena + at.drive.state)[drives.RUNNING]
    return OK


cdef int emulated_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    """Send one reply per received frame, with the present state."""
    cdef double raw = arena[at.drive.temperature] + 40.0
    cdef uint32_t id = drives.own_id(arena, &at.drive)
    cdef uint8_t data[8]
    cdef double *answer
    cdef int index
    if not drives.answerable(arena, &at.drive):
        return -NOT_FINITE      # no reply with the state of a diverged plant
    pack_motion(data, id, arena + at.drive.wire, drives.seen_position(arena, &at.drive),
        drives.seen_velocity(arena, &at.drive),
                motor_torque(arena, &at.drive))
    data[6] = 0 if not raw > 0.0 else 255 if raw > 255.0 else <uint8_t>raw
    data[7] = error_code(arena, &at.drive)
    if arena[at.reply] == 7.0:
        data[6] = VOLTAGE
    for index in range(<int>(arena + at.drive.outbox)[1]):
        answer = drives.unwritten(arena, &at.drive, index)
        if answer != NULL:
            answer[1], answer[2] = id, arena[at.reply]
            memcpy(&answer[3], data, 8)
    return drives.deliver(arena, &at.drive, frames)


decode = export_decode(<decode_t>cubemars_decode, CUBE_MARS)
encode = export_encode(<encode_t>cubemars_encode, CUBE_MARS)
drive = export(<kernel_t>emulated_kernel, EMULATED)
drive_decode = export_decode(<decode_t>emulated_decode, EMULATED)
drive_encode = export_encode(<encode_t>emulated_encode, EMULATED)
