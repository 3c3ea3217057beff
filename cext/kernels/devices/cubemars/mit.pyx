# cython: freethreading_compatible=True
"""CubeMars AK in MIT mode: encoding of frames, for the driver and the emulated drive.

    command    p16 v12 kp12 kd12 t12, most significant bit first, to the drive's id
    special    FF FF FF FF FF FF FF FC enable, FD disable, FE this position is zero
    reply      id p16 v12 t12 temperature error, from the drive's id or from 0; temperature in °C + 40
               other firmware sends 6 bytes, id p16 v12 t12; or 7, the last of which is a voltage: then temperature and
               error are unknown
    error      a code, according to the manual. In the firmware of an AK40-10 of 2025-06 a mask: 2 above 80 °C, 4 from
               120 °C on, both until it is below; 1 or 4 stop the drive, 2 alone does not

AK Series Module Driver Manual V1.0.18, pages 64 to 68. A code is (x - low) (2^n - 1) / (high - low), truncated and
clamped: the manual's 2^n wraps at the top, where +12.5 rad would become -12.5 rad.
"""

from libc.math cimport NAN
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    FOREIGN, ITEMS, MALFORMED, NOT_FINITE, OK, TAKEN, TIME, Frame, decode_t, encode_t, export, export_decode,
    export_encode, items, kernel_t,
)
from cext.conversion cimport to_u8
cimport cext.kernels.devices.drives as drives
from cext.kernels.devices.mit cimport Mit, all_ones, decode_motion, encode_command, mit_sizes, pack_motion, unpack

cdef enum:
    TOO_HOT = 1                 # error code
    WARM = 2, HOT = 4           # bits of the mask
    STOPS = 5                   # bits of the mask with which the drive stops
    WARM_RAW = 120, HOT_RAW = 160               # °C + 40
    SAME_SAMPLE = 2             # °C between the temperature of a reply and that of its mask
    VOLTAGE = 48                # V, in a reply of 7 bytes


cdef bint is_special(const uint8_t *data) noexcept nogil:
    return all_ones(data, 7) and data[7] >= 0xFC and data[7] <= 0xFE


cdef struct CubeMars:
    Mit mit
    int32_t reply               # bytes of a reply
    int32_t masks               # whether the error is a mask

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
        # 2 in a cool drive is an over-current with either meaning
        arena[at.mit.fault] = data[7] & ~WARM if arena[at.masks] != 0.0 and (
            data[6] > WARM_RAW - SAME_SAMPLE) else data[7]
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
    int32_t masks               # whether its error is a mask
    int32_t warm                # bits of the mask that its temperature has set
    int32_t command_timeout     # s, 0 for none
    int32_t zero_when_enabled   # whether FE sets the zero while it is enabled
    int32_t reply_first         # whether a reply has the state before the command

EMULATED = items((<Emulated *>ITEMS)[0], drives.drive_sizes())


cdef inline uint8_t error_of(double *arena, const Emulated *at) noexcept nogil:
    """Return the error byte of a reply."""
    if arena[at.masks] != 0.0:
        return to_u8(arena[at.drive.fault]) | <uint8_t>arena[at.warm]
    if arena[at.drive.fault] != 0.0:
        return to_u8(arena[at.drive.fault])
    return TOO_HOT if arena[at.drive.temperature] >= arena[at.drive.trip_temperature] else 0


cdef inline double motor_torque(double *arena, const Emulated *at) noexcept nogil:
    """Return the torque of the drive's law, limited by its current."""
    cdef uint8_t stops = STOPS if arena[at.masks] != 0.0 else 0xFF
    cdef bint gives = (arena + at.drive.state)[drives.RUNNING] != 0.0 and not error_of(arena, at) & stops
    return drives.strayed(arena, &at.drive, drives.law(arena, &at.drive) if gives else 0.0)


cdef void fill(double *arena, const Emulated *at, uint8_t *data) noexcept nogil:
    """Write a reply with the present state."""
    cdef double raw = arena[at.drive.temperature] + 40.0
    pack_motion(data, drives.own_id(arena, &at.drive), arena + at.drive.wire, drives.seen_position(arena, &at.drive),
                drives.seen_velocity(arena, &at.drive), motor_torque(arena, at))
    data[6] = 0 if not raw > 0.0 else 255 if raw > 255.0 else <uint8_t>raw
    data[7] = error_of(arena, at)
    if arena[at.reply] == 7.0:
        data[6] = VOLTAGE


cdef int emulated_decode(double *arena, const Emulated *at, const Emulated *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = arena + at.drive.state
    cdef double *command = arena + at.drive.command
    cdef const uint8_t *data = &frame.data[0]
    cdef uint8_t before[8]
    if frame.id != <uint32_t>arena[at.drive.can_id]:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if drives.unreachable(arena, &at.drive):
        return TAKEN
    if arena[at.reply_first] != 0.0 and drives.answerable(arena, &at.drive):
        fill(arena, at, before)
        drives.owe(arena, &at.drive, drives.own_id(arena, &at.drive), <int>arena[at.reply], before)
    if is_special(data):
        if data[7] == 0xFC:
            state[drives.RUNNING] = 1.0
        elif data[7] == 0xFD:
            state[drives.RUNNING] = 0.0
            memset(command, 0, 5 * sizeof(double))
        elif (state[drives.RUNNING] == 0.0 or arena[at.zero_when_enabled] != 0.0) and (
                drives.set_zero(arena, &at.drive)):
            return TAKEN
    else:
        state[drives.LAST_COMMAND] = arena[TIME]
        if state[drives.RUNNING] != 0.0:
            unpack(data, arena + at.drive.wire, command)
    if arena[at.reply_first] == 0.0:
        drives.owe(arena, &at.drive, 0, 0, NULL)
    return TAKEN




cdef int emulated_kernel(double *arena, const Emulated *at, const Emulated *sizes) noexcept nogil:
    cdef double raw = arena[at.drive.temperature] + 40.0
    cdef double timeout = arena[at.command_timeout]
    drives.look(arena, &at.drive)
    if arena[at.drive.power_lost] != 0.0:
        drives.forget(arena, &at.drive)
    if not raw > WARM_RAW:
        arena[at.warm] = 0.0
    else:
        arena[at.warm] = WARM | (HOT if raw >= HOT_RAW or arena[at.warm] >= HOT else 0)
    if timeout > 0.0 and arena[TIME] - (arena + at.drive.state)[drives.LAST_COMMAND] > timeout:
        memset(arena + at.drive.command, 0, 5 * sizeof(double))        # and it stays enabled
    arena[at.drive.torque] = drives.produced(arena, &at.drive, motor_torque(arena, at))
    arena[at.drive.enabled] = (arena + at.drive.state)[drives.RUNNING]
    return OK


cdef int emulated_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    """Send one reply per received frame, with the present state."""
    cdef uint32_t id = drives.own_id(arena, &at.drive)
    cdef uint8_t data[8]
    cdef double *answer
    cdef int index
    if not drives.answerable(arena, &at.drive):
        return -NOT_FINITE      # no reply with the state of a diverged plant
    fill(arena, at, data)
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
