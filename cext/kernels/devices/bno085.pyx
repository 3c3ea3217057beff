# cython: freethreading_compatible=True
"""BNO085 in its mode UART-RVC: messages of 19 bytes at 100 Hz.

    0   0xAA 0xAA       2   index, 0 to 255
    3   yaw, pitch, roll in 0.01°, and the specific force along x, y and z in mg: int16 each
   15   three reserved bytes        18   sum of the bytes 2 to 17

Least significant bytes first. A message with a wrong sum, or an angle outside its range, is dropped, and the search
resumes after its first byte.
"""

from libc.math cimport M_PI, isfinite, rint
from libc.stdint cimport int16_t, int32_t, uint8_t
from libc.string cimport memmove, memset

from cext.abi cimport (
    ITEMS, MALFORMED, NOTED, NOT_FINITE, TAKEN, TIME, Frame, decode_t, encode_t, export_decode, export_encode, items,
)
from cext.kernels.bernoulli cimport lucky
from cext.kernels.devices.sequence cimport missing_before
from cext.kernels.limits cimport clip
from cext.lines.stream_frames cimport BYTES
from cext.ring.newest_ring cimport GAP, START

cdef enum:
    SIZE = 19
    HEADER = 0xAA

cdef enum: # in `state` of an emulated sensor
    NUMBER, DUE, LUCK

cdef double ANGLE = M_PI / 18000.0          # rad
cdef double FORCE = 9.80665e-3              # m/s²


cdef inline int word(const uint8_t *data) noexcept nogil:
    return <int16_t>(data[0] | data[1] << 8)


cdef inline int sum_of(const uint8_t *data) noexcept nogil:
    cdef int total = 0
    cdef int i
    for i in range(2, SIZE - 1):
        total += data[i]
    return total & 0xFF


cdef struct Sensor:
    int32_t yaw, pitch, roll, accel, received, lost, late, corrupt, filled, sequence, buffer

SENSOR = items((<Sensor *>ITEMS)[0], "accel[3] sequence[3] buffer[3]")


cdef int message(double *arena, const Sensor *at, const uint8_t *data, double came) noexcept nogil:
    """Return TAKEN, NOTED for a message that is late, or MALFORMED."""
    cdef int yaw = word(data + 3)
    cdef int pitch = word(data + 5)
    cdef int roll = word(data + 7)
    cdef int missing, i
    if sum_of(data) != data[SIZE - 1] or not (
            -18000 <= yaw <= 18000 and -9000 <= pitch <= 9000 and -18000 <= roll <= 18000):
        return MALFORMED
    missing = missing_before(arena + at.sequence, data[2], 0xFF, came)
    if missing < 0:
        arena[at.late] += 1.0
        return NOTED
    arena[at.lost] += missing
    arena[at.received] += 1.0
    arena[at.yaw], arena[at.pitch], arena[at.roll] = ANGLE * yaw, ANGLE * pitch, ANGLE * roll
    for i in range(3):
        arena[at.accel + i] = FORCE * word(data + 9 + 2 * i)
    return TAKEN


cdef int decode_kernel(double *arena, const Sensor *at, const Sensor *sizes, const Frame *frame) noexcept nogil:
    cdef uint8_t *data = <uint8_t *>(arena + at.buffer)
    cdef int filled = 0 if frame.id != BYTES or frame.flags & GAP else <int>arena[at.filled]
    cdef int answer = NOTED
    cdef int found, i
    for i in range(frame.length if frame.id == BYTES else 0):
        data[filled] = frame.data[i]
        filled += 1
        found = NOTED
        if filled == SIZE:
            found = message(arena, at, data, frame.time * 1e-9)
            if found != MALFORMED:
                filled = 0
            arena[at.corrupt] += found == MALFORMED
            answer = found if found == TAKEN or answer == NOTED else answer
        while filled > 0 and (found == MALFORMED or data[0] != HEADER or (filled > 1 and data[1] != HEADER)):
            found = NOTED
            filled -= 1
            memmove(data, data + 1, filled)
    arena[at.filled] = filled
    return answer


cdef struct Emulated:
    int32_t yaw, pitch, roll, accel, silent, dropped, broken, state

EMULATED = items((<Emulated *>ITEMS)[0], "accel[3] state[3]")


cdef inline void put(uint8_t *data, double x, double most) noexcept nogil:
    cdef int code = <int>rint(clip(x, -most, most))
    data[0], data[1] = <uint8_t>(code & 0xFF), <uint8_t>(code >> 8 & 0xFF)


cdef int send_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef double *state = arena + at.state
    cdef const double *accel = arena + at.accel
    cdef uint8_t *data = &frames[0].data[0]
    cdef int i
    if not isfinite(arena[at.yaw] + arena[at.pitch] + arena[at.roll] + accel[0] + accel[1] + accel[2]):
        return -NOT_FINITE
    if arena[TIME] < state[DUE] - 1e-9:
        return 0
    state[DUE] = (state[DUE] if arena[TIME] < state[DUE] + 0.01 else arena[TIME]) + 0.01
    memset(&frames[0], 0, sizeof(Frame))
    frames[0].flags, frames[0].length = START, SIZE
    data[0] = data[1] = HEADER
    data[2] = <uint8_t>state[NUMBER]
    put(data + 3, arena[at.yaw] / ANGLE, 18000.0)
    put(data + 5, arena[at.pitch] / ANGLE, 9000.0)
    put(data + 7, arena[at.roll] / ANGLE, 18000.0)
    for i in range(3):
        put(data + 9 + 2 * i, accel[i] / FORCE, 32767.0)
    data[SIZE - 1] = <uint8_t>sum_of(data)
    state[NUMBER] = <double>((<int>state[NUMBER] + 1) & 0xFF)
    if arena[at.silent] != 0.0 or lucky(&state[LUCK], arena[at.dropped]):
        return 0
    if lucky(&state[LUCK], arena[at.broken]):
        data[9] ^= 0x15
    return 1


decode = export_decode(<decode_t>decode_kernel, SENSOR)
emulated_encode = export_encode(<encode_t>send_encode, EMULATED)
