# cython: freethreading_compatible=True
"""CubeMars AK in MIT mode: the bytes on the wire, for the driver and for the emulated drive.

    command    p16 v12 kp12 kd12 t12, most significant bit first, to the drive's id
    special    FF FF FF FF FF FF FF FC enable, FD disable, FE this position is zero
    reply      id p16 v12 t12 temperature error, from the drive's id or from 0; temperature in °C + 40
               of other firmware 6 bytes, id p16 v12 t12; or 7, of which the last is a voltage: then neither temperature nor error is known

AK Series Module Driver Manual V1.0.18, pages 64 to 68. A code is (x - low) (2^n - 1) / (high - low), truncated and
clamped: the manual's 2^n wraps at the top, where +12.5 rad would become -12.5 rad.
"""

from libc.math cimport NAN
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport FOREIGN, MALFORMED, NOT_FINITE, OK, TAKEN, Frame, export, export_decode, export_encode
cimport cext.kernels.devices.drives as drives
from cext.kernels.devices.mit cimport CAN_ID, FAULT, OWN, TEMPERATURE, all_ones, decode_motion, encode_command, pack_motion, unpack

cdef enum:
    TOO_HOT = 1                 # error code
    REPLY = OWN                 # parameter of CubeMars: bytes of a reply
    VOLTAGE = 48                # V, in a reply of 7 bytes
    E_REPLY = drives.FIRST_OWN  # the same of EmulatedCubeMars


cdef bint is_special(const uint8_t *data) noexcept nogil:
    return all_ones(data, 7) and data[7] >= 0xFC and data[7] <= 0xFE


cdef int cubemars_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef uint32_t id = <uint32_t>arena[slots[CAN_ID]]
    cdef const uint8_t *data = &frame.data[0]
    if frame.id != id and (frame.id != 0 or frame.length == 0 or data[0] != id):
        return FOREIGN          # an extended, remote or error frame differs in its high bits
    if frame.length != arena[slots[REPLY]] or data[0] != id:
        return MALFORMED
    decode_motion(arena, slots, data)
    if frame.length == 8:
        arena[slots[TEMPERATURE]] = <double>data[6] - 40.0
        arena[slots[FAULT]] = data[7]
    else:
        arena[slots[TEMPERATURE]] = NAN
    return TAKEN


cdef int cubemars_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef int count = encode_command(arena, slots, &frames[0])
    if count == 1 and is_special(frames[0].data):
        frames[0].data[1] -= 1  # every range at its top reads as enable, disable or zero: one code less of position does not
    return count


cdef int emulated_decode(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef double *state = drives.kept(arena, slots, drives.STATE)
    cdef double *command = drives.kept(arena, slots, drives.COMMAND)
    cdef const uint8_t *data = &frame.data[0]
    if frame.id != <uint32_t>arena[slots[drives.CAN_ID]]:
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if drives.unreachable(arena, slots):
        return TAKEN
    if is_special(data):
        if data[7] == 0xFC:
            state[drives.RUNNING] = 1.0
        elif data[7] == 0xFD:
            state[drives.RUNNING] = 0.0
            memset(command, 0, 5 * sizeof(double))
        else:
            state[drives.ZERO] += drives.seen_position(arena, slots)
    elif state[drives.RUNNING] != 0.0:
        unpack(data, drives.kept(arena, slots, drives.WIRE), command)
    drives.owe(arena, slots, 0, 0, NULL)
    return TAKEN


cdef inline uint8_t error_code(double *arena, const int32_t *slots) noexcept nogil:
    if arena[slots[drives.FAULT]] != 0.0:
        return <uint8_t>arena[slots[drives.FAULT]]
    return TOO_HOT if arena[slots[drives.TEMPERATURE]] >= arena[slots[drives.TRIP_TEMPERATURE]] else 0


cdef inline double motor_torque(double *arena, const int32_t *slots) noexcept nogil:
    """The drive's law, as far as its current goes."""
    if drives.kept(arena, slots, drives.STATE)[drives.RUNNING] == 0.0 or error_code(arena, slots) != 0:
        return 0.0
    return drives.within(drives.law(arena, slots), arena[slots[drives.PEAK]])


cdef int emulated_kernel(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil:
    drives.look(arena, slots)
    if arena[slots[drives.POWER_LOST]] != 0.0:
        drives.forget(arena, slots)
    arena[slots[drives.TORQUE]] = drives.turned(arena, slots, motor_torque(arena, slots))
    arena[slots[drives.ENABLED]] = drives.kept(arena, slots, drives.STATE)[drives.RUNNING]
    return OK


cdef int emulated_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    """One reply for each frame that was heard, with the state of now."""
    cdef double raw = arena[slots[drives.TEMPERATURE]] + 40.0
    cdef uint32_t id = drives.own_id(arena, slots)
    cdef uint8_t data[8]
    cdef double *answer
    cdef int index
    if not drives.answerable(arena, slots):
        return -NOT_FINITE      # a plant that has blown up has no answer
    pack_motion(data, id, drives.kept(arena, slots, drives.WIRE), drives.seen_position(arena, slots), drives.seen_velocity(arena, slots),
                motor_torque(arena, slots))
    data[6] = 0 if not raw > 0.0 else 255 if raw > 255.0 else <uint8_t>raw
    data[7] = error_code(arena, slots)
    if arena[slots[E_REPLY]] == 7.0:
        data[6] = VOLTAGE
    for index in range(<int>drives.kept(arena, slots, drives.OUTBOX)[1]):
        answer = drives.unwritten(arena, slots, index)
        if answer != NULL:
            answer[1], answer[2] = id, arena[slots[E_REPLY]]
            memcpy(&answer[3], data, 8)
    return drives.deliver(arena, slots, frames)


decode = export_decode(cubemars_decode)
encode = export_encode(cubemars_encode)
drive = export(emulated_kernel)
drive_decode = export_decode(emulated_decode)
drive_encode = export_encode(emulated_encode)
