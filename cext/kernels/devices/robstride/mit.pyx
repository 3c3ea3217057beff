# cython: freethreading_compatible=True
"""RobStride actuators in MIT mode: standard frames, for the driver and the emulated drive.

    command    p16 v12 kp12 kd12 t12, to the drive's id
    special    FF FF FF FF FF FF m x: FC enable, or with m = 0 select operation control; FD disable; FE set the zero
    here;
               FB with m = FF clear faults, else read them; others configure the drive
    reply      id p16 v12 t12, temperature x 10 in 16 bits, from the host's id
    faults     id, word of 32 bits, from the host's id: the answer to FB, not distinguishable from a reply
    parameter  0x300 | id read, 0x400 | id write: index u16, 0, four bytes, little-endian; answered from the same id

RobStride user manuals of 2026-04-28, section 6.

Faults are read in the batch of arming, after a parameter whose answer has its own id; and once per second in a tick in
which no reply is pending and no command is sent. The drive holds its last command for that period; the law of that
command is therefore bounded over one more period. While an answer may be outstanding, a frame with the lowest code of
position or of velocity is the word of faults: no reply of a joint within its range has either.
"""

from libc.stdint cimport int16_t, int32_t, uint8_t, uint16_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport (
    ANSWERED, AUTHORITY, COMMANDED, FOREIGN, ITEMS, MALFORMED, NOTED, NOT_FINITE, OK, PERIOD, POWER_LOSS, TAKEN, TIME,
    Frame, decode_t, encode_t, export, export_decode, export_encode, items, kernel_t,
)
from cext.conversion cimport to_u32
cimport cext.kernels.devices.drives as drives
from cext.kernels.devices.drive_law cimport oldest_age
from cext.kernels.devices.mit cimport Mit, all_ones, decode_motion, encode_command, mit_sizes, pack_motion, unpack
from cext.kernels.devices.robstride.settings cimport (
    PLACE, POSITION_INDEX, READ_BACK_SIZE, READY, VALUE, VELOCITY_INDEX, compare_motion, differs, is_as_written,
    little_endian, note_read, place_of, settings_size,
)

cdef enum: # in `talk`, after what cext/kernels/devices/robstride/settings.pxd keeps there
    OUTSTANDING = READ_BACK_SIZE        # replies accepted while waiting for the word of faults; 0: not waiting
    OWED                        # commands without a reply
    NEXT                        # time of the next read of faults, s
    PREPARED                    # the command in force allows a tick without a command
    WAITED                      # ticks without a reply while a read of faults was due
    WORD                        # bits of faults

cdef enum:
    READ = 0x300
    WRITE = 0x400
    RUN_MODE_INDEX = 0x7005
    TIMEOUT_INDEX = 0x7028
    LOST_AFTER = 50             # ticks, or later replies, until a missing reply counts as lost
    KNOWN_FAULTS = 0x408F       # bits 0, 1, 2, 3, 7, 14

# in `fault`: the drive has returned another value of a setting than was written, which the lower 32 bits then contain;
# and the start of the place of the setting
cdef double DIFFERENT = 4294967296.0
cdef double PLACE_UNIT = 8589934592.0
cdef double READ_PERIOD = 1.0                   # s, between two reads of the faults

cdef enum:
    FAULTS_ASKED = 1            # in place of the id of a reply that is not filled in yet; or the index of a parameter


cdef inline void put_little(uint8_t *data, uint32_t value) noexcept nogil:
    cdef int i
    for i in range(4):
        data[i] = <uint8_t>(value >> 8 * i)


cdef inline uint32_t index_of(const uint8_t *data) noexcept nogil:
    return <uint32_t>data[1] << 8 | data[0]


cdef inline bint may_be_faults(const uint8_t *data) noexcept nogil:
    """Return whether the position or the velocity is at its lowest code."""
    return (data[1] == 0 and data[2] == 0) or (data[3] == 0 and data[4] >> 4 == 0)


cdef inline uint32_t fault_word(const uint8_t *data) noexcept nogil:
    """Return the word of faults.

    Little-endian as parameters, which the manual does not state; big-endian if only that gives bits that exist.
    """
    cdef uint32_t word = little_endian(data + 1)
    cdef uint32_t other = <uint32_t>data[1] << 24 | <uint32_t>data[2] << 16 | <uint32_t>data[3] << 8 | data[4]
    return other if word & ~<uint32_t>KNOWN_FAULTS and not other & ~<uint32_t>KNOWN_FAULTS else word


cdef struct Driver:
    Mit mit
    int32_t host_id
    int32_t talk                # the enum above
    int32_t settings            # see cext/kernels/devices/robstride/settings.pxd
    int32_t arrival             # time of the newest frame, s
    int32_t gear_ratio

DRIVER = items((<Driver *>ITEMS)[0], mit_sizes() + " talk[11] " + settings_size())


cdef inline void tell_fault(double *arena, const Driver *at, const double *talk) noexcept nogil:
    arena[at.mit.fault] = DIFFERENT + PLACE_UNIT * talk[PLACE] + talk[VALUE] if differs(talk) else talk[WORD]


cdef inline void note_arrival(double *arena, const Driver *at, double *talk, const Frame *frame) noexcept nogil:
    """Forget the faults of a drive that may have restarted while the run waits: the next arming reads them again."""
    cdef double came = frame.time * 1e-9
    if arena[AUTHORITY] == 0.0 and came - arena[at.arrival] > 1e-9 * POWER_LOSS:
        talk[WORD] = 0.0
        tell_fault(arena, at, talk)
    arena[at.arrival] = came


cdef int parameter_read(double *arena, const Driver *at, double *talk, const uint8_t *data) noexcept nogil:
    """Decode a parameter that was read during arming; the request of faults follows the last of the settings."""
    cdef const double *settings = arena + at.settings
    if talk[READY] == 0.0 and compare_motion(
            talk, data, arena[at.mit.invert], arena[at.gear_ratio], arena[at.mit.position] + arena[at.mit.offset],
            arena[at.mit.velocity], (arena + at.mit.wire)[0]):
        tell_fault(arena, at, talk)
        return NOTED
    cdef int place = place_of(settings, index_of(data))
    if place < 0:
        return NOTED
    if place == <int>settings[0] - 1:
        talk[OUTSTANDING] = LOST_AFTER
    if talk[READY] != 0.0:
        return NOTED
    note_read(settings, talk, place, little_endian(data + 4), True)
    tell_fault(arena, at, talk)
    return NOTED


cdef int parameter_written(const double *settings, const double *talk, const uint8_t *data) noexcept nogil:
    """Decode a parameter. After arming, a value other than the written ones is from another controller."""
    cdef int place = place_of(settings, index_of(data))
    if talk[READY] == 0.0 or (place >= 0 and is_as_written(settings, place, little_endian(data + 4))):
        return NOTED
    return COMMANDED


cdef int mit_decode(double *arena, const Driver *at, const Driver *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    cdef double *talk = arena + at.talk
    cdef uint32_t id = <uint32_t>arena[at.mit.can_id]
    if frame.id == (READ | id) or frame.id == (WRITE | id):
        if frame.length != 8:
            return MALFORMED
        note_arrival(arena, at, talk, frame)
        return parameter_read(arena, at, talk, data) if frame.id == (READ | id) else parameter_written(
            arena + at.settings, talk, data)
    if frame.id != <uint32_t>arena[at.host_id] or frame.length == 0 or data[0] != id:
        return FOREIGN          # drives share the host's id
    if frame.length != 8:
        return MALFORMED
    note_arrival(arena, at, talk, frame)
    if talk[OUTSTANDING] > 0.0:
        if may_be_faults(data):
            talk[OUTSTANDING] = 0.0
            talk[NEXT] = arena[TIME] + READ_PERIOD
            talk[WORD] = fault_word(data)
            tell_fault(arena, at, talk)
            return ANSWERED
        talk[OUTSTANDING] -= 1.0
    if talk[OWED] > 0.0:
        talk[OWED] -= 1.0
    decode_motion(arena, &at.mit, data)
    arena[at.mit.temperature] = 0.1 * <int16_t>(<uint16_t>(data[6] << 8 | data[7]))
    return TAKEN


cdef inline bint reads_faults_now(double *arena, const Driver *at, double *talk) noexcept nogil:
    """Return whether this tick requests the faults instead of sending a command."""
    if not arena[AUTHORITY] > 0.0 or arena[TIME] + 1e-9 < talk[NEXT]:
        return False            # a run that waits to be rearmed sends nothing
    if talk[READY] == 0.0 and arena[at.settings] != 0.0:
        return False            # a drive that was never armed does not answer
    if talk[OWED] > 0.0:
        talk[WAITED] += 1.0
        if talk[WAITED] < LOST_AFTER:
            return False
        talk[OWED] = 0.0
    return talk[PREPARED] != 0.0


cdef int mit_encode(double *arena, const Driver *at, const Driver *sizes, Frame *frames) noexcept nogil:
    cdef double *talk = arena + at.talk
    cdef double *sent = arena + at.mit.sent
    cdef double period = arena[PERIOD]
    cdef double transit = arena[at.mit.transit]
    cdef double torque = arena[at.mit.torque_sent]
    cdef double[5] held
    cdef bint asks = reads_faults_now(arena, at, talk)
    cdef int count
    memcpy(held, sent, sizeof(held))
    # the command before a request stays in force for one more period, over which its law is bounded too
    talk[PREPARED] = (
        not asks and (talk[READY] != 0.0 or arena[at.settings] == 0.0)
        and arena[TIME] + period + 1e-9 >= talk[NEXT]
        and arena[at.mit.age] + (arena + at.mit.transit)[2] <= oldest_age(period, arena[at.mit.max_transit]))
    if talk[PREPARED] != 0.0:
        arena[PERIOD], arena[at.mit.transit] = 1.5 * period, transit + 0.5 * period
    count = encode_command(arena, &at.mit, &frames[0])
    arena[PERIOD], arena[at.mit.transit] = period, transit
    if count != 1:
        return count
    if asks:                    # the command is checked but not sent; the last one stays in force
        memcpy(sent, held, sizeof(held))
        arena[at.mit.torque_sent] = torque
        memset(frames[0].data, 0xFF, 6)
        frames[0].data[6], frames[0].data[7] = 0, 0xFB
        talk[OUTSTANDING], talk[WAITED] = LOST_AFTER, 0.0
        talk[NEXT] = arena[TIME] + READ_PERIOD
        return 1
    talk[OWED] += 1.0
    if all_ones(frames[0].data, 6):
        # six bytes FF would configure the drive: reduce the position by one code
        frames[0].data[1] -= 1
    return 1


# The emulated drive

cdef struct Emulated:
    drives.Drive drive
    int32_t host_id
    int32_t registers           # encoded values of the parameters 0x7000 to 0x703F
    int32_t latched             # faults until they are cleared
    int32_t too_old             # whether the firmware has no parameters
    int32_t left_velocity       # rad/s, with which another program has left it running
    int32_t ignored             # whether writes have no effect, for each register

EMULATED = items((<Emulated *>ITEMS)[0], drives.drive_sizes() + " registers[64] ignored[64]")

cdef double VELOCITY_GAIN = 5.0                 # N·m·s/rad

cdef enum:
    VELOCITY = 2                # value of the run mode


cdef inline double motor_torque(double *arena, const Emulated *at) noexcept nogil:
    """Return the torque of the drive's law. A written torque limit has no effect, as users report of some firmware."""
    cdef double torque = 0.0
    if (arena + at.drive.state)[drives.RUNNING] != 0.0 and (arena + at.registers)[RUN_MODE_INDEX & 63] == VELOCITY:
        torque = VELOCITY_GAIN * (arena[at.left_velocity] - drives.seen_velocity(arena, &at.drive))
    elif (arena + at.drive.state)[drives.RUNNING] != 0.0:
        torque = drives.law(arena, &at.drive)
    return drives.strayed(arena, &at.drive, torque)


cdef inline void reset(double *arena, const Emulated *at) noexcept nogil:
    (arena + at.drive.state)[drives.RUNNING] = 0.0
    memset(arena + at.drive.command, 0, 5 * sizeof(double))


cdef bint obey(double *arena, const Emulated *at, const uint8_t *data) noexcept nogil:
    """Handle a known special frame (six bytes FF). Returns whether its answer is the drive's state."""
    cdef double *state = arena + at.drive.state
    if data[7] == 0xFC:
        if data[6] == 0xFF and (arena + at.latched)[0] == 0.0:
            state[drives.RUNNING] = 1.0
        elif data[6] != 0xFF and state[drives.RUNNING] == 0.0 and (arena + at.ignored)[RUN_MODE_INDEX & 63] == 0.0:
            (arena + at.registers)[RUN_MODE_INDEX & 63] = data[6]
    elif data[7] == 0xFD and data[6] == 0xFF:
        reset(arena, at)
    elif data[7] == 0xFE and data[6] == 0xFF:
        return not drives.set_zero(arena, &at.drive)
    elif data[7] == 0xFB and data[6] == 0xFF:
        (arena + at.latched)[0] = 0.0
    elif data[7] == 0xFB:
        drives.owe(arena, &at.drive, FAULTS_ASKED, 0, NULL)
        return False
    return True


cdef void parameter(double *arena, const Emulated *at, uint32_t kind, const uint8_t *data) noexcept nogil:
    """Read or write a known parameter, and queue the answer from the same id."""
    cdef double *registers = arena + at.registers
    cdef uint32_t index = index_of(data)
    cdef uint8_t out[8]
    if (arena + at.too_old)[0] != 0.0 or index >> 6 != 0x7000 >> 6:
        return
    memcpy(out, data, 8)
    if index == POSITION_INDEX or index == VELOCITY_INDEX:
        drives.owe(arena, &at.drive, index, 0, NULL)
        return
    if kind == WRITE and (arena + at.ignored)[index & 63] == 0.0:
        registers[index & 63] = little_endian(data + 4)
    put_little(out + 4, to_u32(registers[index & 63]))
    drives.owe(arena, &at.drive, kind | drives.own_id(arena, &at.drive), 8, out)


cdef int heard_decode(double *arena, const Emulated *at, const Emulated *sizes, const Frame *frame) noexcept nogil:
    cdef uint32_t id = <uint32_t>arena[at.drive.can_id]
    cdef uint32_t kind = frame.id & ~<uint32_t>0xFF
    if frame.id != id and frame.id != (READ | id) and frame.id != (WRITE | id):
        return FOREIGN
    if frame.length != 8:
        return MALFORMED
    if drives.unreachable(arena, &at.drive):
        return TAKEN
    (arena + at.drive.state)[drives.LAST_COMMAND] = arena[TIME]
    if kind != 0:
        parameter(arena, at, kind, frame.data)
        return TAKEN
    if all_ones(frame.data, 6) and (frame.data[7] >= 0xF8 and frame.data[7] != 0xFF or frame.data[7] == 1):
        if not obey(arena, at, frame.data):
            return TAKEN
    elif (arena + at.drive.state)[drives.RUNNING] != 0.0:
        unpack(frame.data, arena + at.drive.wire, arena + at.drive.command)
    drives.owe(arena, &at.drive, 0, 0, NULL)
    return TAKEN


cdef int drive_kernel(double *arena, const Emulated *at, const Emulated *sizes) noexcept nogil:
    cdef double *state = arena + at.drive.state
    cdef double *registers = arena + at.registers
    cdef double *latched = arena + at.latched
    cdef double timeout = registers[TIMEOUT_INDEX & 63] / 20000.0
    cdef double fault = arena[at.drive.fault]
    drives.look(arena, &at.drive)
    if arena[at.drive.power_lost] != 0.0:
        drives.forget(arena, &at.drive)
        memset(registers, 0, 64 * sizeof(double))
        latched[0] = 0.0
    latched[0] = <double>(<uint32_t>latched[0] | to_u32(fault) | (
        1 if arena[at.drive.temperature] >= arena[at.drive.trip_temperature] else 0))
    if latched[0] != 0.0 or (timeout > 0.0 and state[drives.RUNNING] != 0.0 and arena[TIME]
            - state[drives.LAST_COMMAND] > timeout):
        reset(arena, at)
    arena[at.drive.torque] = drives.produced(arena, &at.drive, motor_torque(arena, at))
    arena[at.drive.enabled] = state[drives.RUNNING]
    return OK


cdef void measured(double *arena, const Emulated *at, uint32_t index, uint8_t *data) noexcept nogil:
    """Write the reply to a read of mechPos or mechVel."""
    cdef float single = <float>(arena[at.drive.gear_ratio] * (
        drives.seen_position(arena, &at.drive) if index == POSITION_INDEX else drives.seen_velocity(arena, &at.drive)))
    memset(data, 0, 8)
    data[0], data[1] = <uint8_t>index, <uint8_t>(index >> 8)
    memcpy(data + 4, &single, 4)


cdef int answer_encode(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef double raw = arena[at.drive.temperature] * 10.0
    cdef uint32_t code
    cdef uint8_t data[8]
    cdef uint8_t faults[8]
    cdef uint8_t value[8]
    cdef double *answer
    cdef int index
    if not drives.answerable(arena, &at.drive):
        return -NOT_FINITE
    pack_motion(data, drives.own_id(arena, &at.drive), arena + at.drive.wire, drives.seen_position(arena, &at.drive),
                drives.seen_velocity(arena, &at.drive), motor_torque(arena, at))
    code = <uint32_t><int16_t>(32767.0 if raw > 32767.0 else raw if raw > -32768.0 else -32768.0)
    data[6] = <uint8_t>(code >> 8)
    data[7] = <uint8_t>code
    memset(faults, 0, 8)
    faults[0] = data[0]
    put_little(faults + 1, <uint32_t>(arena + at.latched)[0])
    for index in range(<int>(arena + at.drive.outbox)[1]):
        answer = drives.unwritten(arena, &at.drive, index)
        if answer != NULL and answer[1] >= POSITION_INDEX:
            measured(arena, at, <uint32_t>answer[1], value)
            memcpy(&answer[3], value, 8)
            answer[1], answer[2] = READ | drives.own_id(arena, &at.drive), 8.0
        elif answer != NULL:
            memcpy(&answer[3], &faults[0] if answer[1] == FAULTS_ASKED else &data[0], 8)
            answer[1], answer[2] = arena[at.host_id], 8.0
    return drives.deliver(arena, &at.drive, frames)


decode = export_decode(<decode_t>mit_decode, DRIVER)
encode = export_encode(<encode_t>mit_encode, DRIVER)
drive = export(<kernel_t>drive_kernel, EMULATED)
drive_decode = export_decode(<decode_t>heard_decode, EMULATED)
drive_encode = export_encode(<encode_t>answer_encode, EMULATED)
