# cython: freethreading_compatible=True
"""Damiao drives in MIT mode, for the driver and the emulated drive. The bytes are those of protocol.py."""

from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    COMMANDED, FOREIGN, IDLE, ITEMS, MALFORMED, NOTED, NOT_FINITE, OK, TAKEN, TIME, Frame, decode_t, encode_t, export,
    export_decode, export_encode, items, kernel_t,
)
from cext.conversion cimport to_u32
cimport cext.kernels.devices.drives as drives
from cext.kernels.devices.mit cimport Mit, all_ones, decode_motion, encode_command, mit_sizes, pack_motion, unpack
from cext.kernels.devices.robstride.settings cimport (
    PLACE, READY, VALUE, differs, little_endian, note_read, place_of, settings_size,
)

cdef enum:
    BROADCAST = 0x7FF
    READ = 0x33, WRITE = 0x55, STORE = 0xAA, REFRESH = 0xCC
    MST_ID = 7, ESC_ID = 8, TIMEOUT = 9, CTRL_MODE = 10, PMAX = 21, VMAX = 22, TMAX = 23, XOUT = 81
    REGISTERS = 96
    ENABLED = 1, LOST = 13, MOSFETS_HOT = 11    # status

cdef double DIFFERENT = 4294967296.0            # in `fault`; the place of the register follows
cdef double PLACE_UNIT = 8589934592.0


cdef inline bint is_register(const uint8_t *data) noexcept nogil:
    """Return whether a frame from MST_ID is a reply of a register, not a state."""
    return (data[0] < 16 and data[1] == 0 and (data[2] == READ or data[2] == WRITE or data[2] == STORE)
            and data[3] <= XOUT)


cdef struct Driver:
    Mit mit
    int32_t master_id
    int32_t talk                # see cext/kernels/devices/robstride/settings.pxd
    int32_t settings

DRIVER = items((<Driver *>ITEMS)[0], mit_sizes() + " talk[5] " + settings_size())


cdef int driver_decode(double *arena, const Driver *at, const Driver *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    cdef double *talk = arena + at.talk
    cdef const double *settings = arena + at.settings
    cdef uint32_t id = <uint32_t>arena[at.mit.can_id]
    cdef uint8_t status
    cdef int place
    if frame.id == BROADCAST and frame.length == 8 and data[0] == id and data[1] == 0 and (
            data[2] == WRITE or data[2] == STORE):
        return COMMANDED        # another program changes its registers
    if frame.id != <uint32_t>arena[at.master_id] or frame.length == 0 or data[0] & 15 != id:
        return FOREIGN          # drives may share the host's id
    if frame.length != 8:
        return MALFORMED
    if is_register(data):
        place = place_of(settings, data[3])
        if data[2] == READ and place >= 0 and talk[READY] == 0.0:
            note_read(settings, talk, place, little_endian(data + 4), True)
            if differs(talk):
                arena[at.mit.fault] = DIFFERENT + PLACE_UNIT * talk[PLACE] + talk[VALUE]
        return NOTED
    status = data[0] >> 4
    decode_motion(arena, &at.mit, data)
    arena[at.mit.temperature] = data[6] if data[6] > data[7] else data[7]
    if not differs(talk):
        arena[at.mit.fault] = status if status > ENABLED else 0
    return TAKEN if status == ENABLED else IDLE


cdef int driver_encode(double *arena, const Driver *at, const Driver *sizes, Frame *frames) noexcept nogil:
    cdef int count = encode_command(arena, &at.mit, &frames[0])
    if count == 1 and all_ones(frames[0].data, 7) and frames[0].data[7] >= 0xF8:
        # all ranges at their top would be a special frame: reduce the position by one code
        frames[0].data[1] -= 1
    return count


# The emulated drive

cdef struct Emulated:
    drives.Drive drive
    int32_t registers
    int32_t stored              # registers after power-on
    int32_t latched             # status of the fault until it is cleared

EMULATED = items((<Emulated *>ITEMS)[0], drives.drive_sizes() + " registers[96] stored[96]")


cdef inline bint is_whole(int index) noexcept nogil:
    return 7 <= index <= 10 or 13 <= index <= 16 or index == 35 or index == 36


cdef inline double motor_torque(double *arena, const Emulated *at) noexcept nogil:
    """Return the torque of the drive's law."""
    return drives.strayed(arena, &at.drive, drives.law(arena, &at.drive) if (
        arena + at.drive.state)[drives.RUNNING] != 0.0 else 0.0)


cdef inline void reset(double *arena, const Emulated *at) noexcept nogil:
    (arena + at.drive.state)[drives.RUNNING] = 0.0
    memset(arena + at.drive.command, 0, 5 * sizeof(double))


cdef inline void apply(double *arena, const Emulated *at) noexcept nogil:
    """Let the id and the ranges of the registers take effect."""
    cdef const double *registers = arena + at.registers
    cdef double *wire = arena + at.drive.wire
    cdef double gear = arena[at.drive.gear_ratio]
    arena[at.drive.can_id] = registers[ESC_ID]
    wire[0], wire[1], wire[4] = registers[PMAX] / gear, registers[VMAX] / gear, registers[TMAX] * gear


cdef void answer(double *arena, const Emulated *at, const uint8_t *data) noexcept nogil:
    """Carry out a register frame, and queue its reply."""
    cdef double *registers = arena + at.registers
    cdef double value
    cdef float single
    cdef uint32_t bits = little_endian(data + 4)
    cdef uint8_t out[8]
    cdef int index = data[3]
    if data[2] == REFRESH:
        drives.owe(arena, &at.drive, 0, 0, NULL)
        return
    memcpy(out, data, 8)
    if data[2] == STORE and (arena + at.drive.state)[drives.RUNNING] == 0.0:
        memcpy(arena + at.stored, registers, REGISTERS * sizeof(double))
        drives.owe(arena, &at.drive, <uint32_t>registers[MST_ID], 8, out)
    if data[2] != READ and data[2] != WRITE or index > XOUT:
        return
    registers[XOUT] = arena[at.drive.gear_ratio] * drives.seen_position(arena, &at.drive)
    if data[2] == WRITE and (index <= CTRL_MODE or 21 <= index <= 35):
        memcpy(&single, &bits, 4)
        registers[index] = <double>bits if is_whole(index) else single
        apply(arena, at)
    value = registers[index]
    single = <float>value
    bits = to_u32(value)
    memcpy(out + 4, &bits if is_whole(index) else <uint32_t *>&single, 4)
    drives.owe(arena, &at.drive, <uint32_t>registers[MST_ID], 8, out)


cdef int emulated_decode(double *arena, const Emulated *at, const Emulated *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    cdef double *state = arena + at.drive.state
    cdef uint32_t id = <uint32_t>arena[at.drive.can_id]
    if frame.id != id and (frame.id != BROADCAST or frame.length != 8 or data[0] != id or data[1] != 0):
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if drives.unreachable(arena, &at.drive):
        return TAKEN
    if frame.id == BROADCAST:
        answer(arena, at, data)
        return TAKEN
    state[drives.LAST_COMMAND] = arena[TIME]
    if all_ones(data, 7) and 0xFB <= data[7] <= 0xFE:
        if data[7] == 0xFC and arena[at.latched] == 0.0:
            state[drives.RUNNING] = 1.0
        elif data[7] == 0xFD:
            reset(arena, at)
        elif data[7] == 0xFB:
            arena[at.latched] = 0.0
        elif data[7] == 0xFE and drives.set_zero(arena, &at.drive):
            return TAKEN
    elif state[drives.RUNNING] != 0.0 and (arena + at.registers)[CTRL_MODE] == 1.0:
        unpack(data, arena + at.drive.wire, arena + at.drive.command)
    drives.owe(arena, &at.drive, 0, 0, NULL)
    return TAKEN


cdef int emulated_kernel(double *arena, const Emulated *at, const Emulated *sizes) noexcept nogil:
    cdef double *state = arena + at.drive.state
    cdef double timeout
    drives.look(arena, &at.drive)
    if arena[at.drive.power_lost] != 0.0:
        drives.forget(arena, &at.drive)
        memcpy(arena + at.registers, arena + at.stored, REGISTERS * sizeof(double))
        apply(arena, at)
        arena[at.latched] = 0.0
    timeout = (arena + at.registers)[TIMEOUT] / 20000.0
    if arena[at.drive.fault] != 0.0:
        arena[at.latched] = to_u32(arena[at.drive.fault]) & 15
    elif arena[at.drive.temperature] >= arena[at.drive.trip_temperature]:
        arena[at.latched] = MOSFETS_HOT
    elif timeout > 0.0 and state[drives.RUNNING] != 0.0 and arena[TIME] - state[drives.LAST_COMMAND] > timeout:
        arena[at.latched] = LOST
    if arena[at.latched] != 0.0:
        reset(arena, at)
    arena[at.drive.torque] = drives.produced(arena, &at.drive, motor_torque(arena, at))
    arena[at.drive.enabled] = state[drives.RUNNING]
    return OK


cdef int emulated_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    """Send one reply per received frame; those with the state have the present one."""
    cdef double raw = arena[at.drive.temperature]
    cdef double status = arena[at.latched]
    cdef uint8_t data[8]
    cdef double *pending
    cdef int index
    if not drives.answerable(arena, &at.drive):
        return -NOT_FINITE
    if status == 0.0:
        status = (arena + at.drive.state)[drives.RUNNING]
    pack_motion(data, drives.own_id(arena, &at.drive), arena + at.drive.wire, drives.seen_position(arena, &at.drive),
                drives.seen_velocity(arena, &at.drive), motor_torque(arena, at))
    data[0] = <uint8_t>(<int>status << 4 | data[0] & 15)
    data[6] = data[7] = 0 if not raw > 0.0 else 255 if raw > 255.0 else <uint8_t>raw
    for index in range(<int>(arena + at.drive.outbox)[1]):
        pending = drives.unwritten(arena, &at.drive, index)
        if pending != NULL:
            pending[1], pending[2] = (arena + at.registers)[MST_ID], 8.0
            memcpy(&pending[3], data, 8)
    return drives.deliver(arena, &at.drive, frames)


decode = export_decode(<decode_t>driver_decode, DRIVER)
encode = export_encode(<encode_t>driver_encode, DRIVER)
drive = export(<kernel_t>emulated_kernel, EMULATED)
drive_decode = export_decode(<decode_t>emulated_decode, EMULATED)
drive_encode = export_encode(<encode_t>emulated_encode, EMULATED)
