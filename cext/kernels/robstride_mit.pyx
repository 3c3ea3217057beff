# cython: freethreading_compatible=True
"""RobStride actuators that have been set to MIT mode: standard frames, for the driver and for the emulated drive.

    command    p16 v12 kp12 kd12 t12, to the drive's id
    special    FF FF FF FF FF FF m x: FC enable, or with m = 0 choose operation control; FD disable; FE this position is zero;
               FB with m = FF clear faults; others set the drive up
    reply      id p16 v12 t12, temperature x 10 in 16 bits, from the host's id; it tells no faults

RobStride user manuals of 2026-04-28, section 6.
"""

from libc.stdint cimport int16_t, int32_t, uint8_t, uint16_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport FOREIGN, MALFORMED, NOT_FINITE, OK, TAKEN, Frame, export, export_decode, export_encode
cimport cext.kernels.drives as drives
from cext.kernels.mit cimport CAN_ID, OWN, TEMPERATURE, all_ones, decode_motion, encode_command, pack_motion, unpack

cdef enum:
    HOST_ID = OWN               # parameter of RobStrideMIT

cdef enum:
    E_HOST_ID = drives.FIRST_OWN        # parameter of EmulatedRobStrideMIT


cdef int mit_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    if frame.id != <uint32_t>arena[slots[HOST_ID]] or frame.length == 0 or data[0] != <uint32_t>arena[slots[CAN_ID]]:
        return FOREIGN          # drives share the host's id
    if frame.length != 8:
        return MALFORMED
    decode_motion(arena, slots, data)
    arena[slots[TEMPERATURE]] = 0.1 * <int16_t>(<uint16_t>(data[6] << 8 | data[7]))
    return TAKEN


cdef int mit_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef int count = encode_command(arena, slots, &frames[0])
    if count == 1 and all_ones(frames[0].data, 6):
        frames[0].data[1] -= 1  # what begins with six bytes of ones sets the drive up: one code less of position does not
    return count


cdef inline double motor_torque(double *arena, const int32_t *slots) noexcept nogil:
    if drives.kept(arena, slots, drives.STATE)[drives.RUNNING] == 0.0:
        return 0.0
    return drives.within(drives.law(arena, slots), arena[slots[drives.PEAK]])


cdef void obey(double *arena, const int32_t *slots, const uint8_t *data) noexcept nogil:
    """A frame of six bytes of ones: those that are known."""
    cdef double *state = drives.kept(arena, slots, drives.STATE)
    if data[7] == 0xFC:
        if data[6] == 0xFF:
            state[drives.RUNNING] = 1.0
    elif data[7] == 0xFD and data[6] == 0xFF:
        state[drives.RUNNING] = 0.0
        memset(drives.kept(arena, slots, drives.COMMAND), 0, 5 * sizeof(double))
    elif data[7] == 0xFE and data[6] == 0xFF:
        state[drives.ZERO] += drives.seen_position(arena, slots)


cdef int heard_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    if frame.id != <uint32_t>arena[slots[drives.CAN_ID]]:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if drives.unreachable(arena, slots):
        return TAKEN
    if all_ones(frame.data, 6) and (frame.data[7] >= 0xF8 and frame.data[7] != 0xFF or frame.data[7] == 1):
        obey(arena, slots, frame.data)
    elif drives.kept(arena, slots, drives.STATE)[drives.RUNNING] != 0.0:
        unpack(frame.data, drives.kept(arena, slots, drives.WIRE), drives.kept(arena, slots, drives.COMMAND))
    drives.owe(arena, slots, 0, 0, NULL)
    return TAKEN


cdef int drive_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    drives.look(arena, slots)
    if arena[slots[drives.POWER_LOST]] != 0.0:
        drives.forget(arena, slots)
    if arena[slots[drives.FAULT]] != 0.0 or arena[slots[drives.TEMPERATURE]] >= arena[slots[drives.TRIP_TEMPERATURE]]:
        drives.kept(arena, slots, drives.STATE)[drives.RUNNING] = 0.0
    arena[slots[drives.TORQUE]] = drives.turned(arena, slots, motor_torque(arena, slots))
    arena[slots[drives.ENABLED]] = drives.kept(arena, slots, drives.STATE)[drives.RUNNING]
    return OK


cdef int answer_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double raw = arena[slots[drives.TEMPERATURE]] * 10.0
    cdef uint32_t code
    cdef uint8_t data[8]
    cdef double *answer
    cdef int index
    if not drives.answerable(arena, slots):
        return -NOT_FINITE
    pack_motion(data, drives.own_id(arena, slots), drives.kept(arena, slots, drives.WIRE), drives.seen_position(arena, slots),
                drives.seen_velocity(arena, slots), motor_torque(arena, slots))
    code = <uint32_t><int16_t>(32767.0 if raw > 32767.0 else raw if raw > -32768.0 else -32768.0)
    data[6] = <uint8_t>(code >> 8)
    data[7] = <uint8_t>code
    for index in range(<int>drives.kept(arena, slots, drives.OUTBOX)[1]):
        answer = drives.unwritten(arena, slots, index)
        if answer != NULL:
            answer[1], answer[2] = arena[slots[E_HOST_ID]], 8.0
            memcpy(&answer[3], data, 8)
    return drives.deliver(arena, slots, frames)


decode = export_decode(mit_decode)
encode = export_encode(mit_encode)
drive = export(drive_kernel)
drive_decode = export_decode(heard_decode)
drive_encode = export_encode(answer_encode)
